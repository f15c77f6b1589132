from soak.ledger import Ledger
from soak.relays import Move, Rules

from bridge.simulator.module import Switching

PULSE = 2
FRAME = b"a frame"


def ledger() -> Ledger:
    """A ledger of a house whose outputs 2 are pulses."""
    return Ledger(Rules(pulses=frozenset({PULSE})))


def switched(at: float, output: int, *, value: bool = True, changed: bool = True) -> Move:
    """A relay of station `s` obeyed a frame."""
    return Move("s", Switching(at, output, value, FRAME, changed))


def test_a_relay_that_obeys_a_command_is_in_order() -> None:
    """Sent, switched, answered: nothing is wrong."""
    books = ledger()
    number = books.sent("s", {1: True}, now=10.0)
    books.answered(number, b"1", {"status": "done"}, now=10.2)
    books.judge([switched(10.1, 1)], now=300.0)
    tally = books.tally
    assert (tally.switched, tally.wrong, tally.missing, tally.answered) == (1, 0, 0, 1)
    assert tally.longest_s == 10.2 - 10.0


def test_a_relay_that_nobody_commanded_is_wrong() -> None:
    """Another output, another value, before the command or after its verdict."""
    for stray in (
        switched(10.1, 3),
        switched(10.1, 1, value=False),
        switched(9.9, 1),
        switched(10.3, 1),
        switched(10.1, 1)._replace(station_id="t"),
    ):
        books = ledger()
        number = books.sent("s", {1: True}, now=10.0)
        books.answered(number, b"1", {"status": "done"}, now=10.2)
        books.judge([stray], now=20.0)
        assert books.tally.wrong == 1


def test_gaps_that_are_written_as_they_were_and_ends_of_pulses_are_not_wrong() -> None:
    """Unchanged outputs in a range, and ends of pulses, need no command."""
    books = ledger()
    pulse_end = Switching(10.1, PULSE, value=False, frame=b"", changed=True)
    books.judge([switched(10.1, 3, changed=False), Move("s", pulse_end)], now=20.0)
    assert books.tally.wrong == 0


def test_a_second_pulse_for_one_command_is_counted() -> None:
    """A second pulse for one command is counted, also during the first one."""
    books = ledger()
    books.sent("s", {PULSE: True}, now=10.0)
    books.judge([switched(10.1, PULSE), switched(10.2, PULSE, changed=False)], now=20.0)
    assert (books.tally.wrong, books.tally.twice) == (0, 1)


def test_a_pulse_called_done_that_no_relay_saw_is_counted() -> None:
    """A false `done` is as bad as a false switching."""
    books = ledger()
    number = books.sent("s", {PULSE: True}, now=10.0)
    books.answered(number, b"1", {"status": "done"}, now=10.2)
    books.judge([], now=300.0)
    assert books.tally.not_sent == 1


def test_a_pulse_belongs_to_the_command_that_was_called_done() -> None:
    """A pulse belongs to the command that was `done`, not to a lost or refused one."""
    books = ledger()
    lost, refused, done = (books.sent("s", {PULSE: True}, now=10.0 + n / 10) for n in range(3))
    books.answered(done, b"1", {"status": "done"}, now=10.5)
    books.answered(lost, b"2", {"status": "unknown"}, now=11.0)
    books.answered(refused, b"3", {"status": "refused"}, now=11.0)
    books.judge([switched(10.4, PULSE)], now=300.0)
    assert (books.tally.not_sent, books.tally.twice, books.tally.wrong) == (0, 0, 0)


def test_a_refused_command_explains_no_relay() -> None:
    """A refused command explains no switched relay."""
    books = ledger()
    number = books.sent("s", {1: True}, now=10.0)
    books.answered(number, b"1", {"status": "refused"}, now=11.0)
    books.judge([switched(10.4, 1)], now=20.0)
    assert books.tally.wrong == 1


def test_a_command_without_a_verdict_is_missing_unless_the_link_was_cut() -> None:
    """A command without a verdict is missing, unless it was sent near a cut of the link."""
    books = ledger()
    for at in (10.0, 18.0, 21.0, 23.0, 40.0):
        books.sent("s", {1: True}, now=at)
    books.link.broken(20.0)
    books.link.mended(20.1)
    books.link.ping(20.5)  # it may have been on its way before
    books.link.ping(22.5)
    assert books.link.whole
    assert books.waiting == 2
    books.judge([], now=300.0)
    assert (books.tally.missing, books.tally.lost) == (2, 3)


def test_a_second_verdict_is_a_contradiction_unless_it_repeats_the_first_around_a_cut() -> None:
    """QoS 1 may deliver the same bytes twice, where a connection was lost."""
    books = ledger()
    first, second = (books.sent("s", {1: True}, now=at) for at in (10.0, 20.0))
    for number, at in ((first, 10.1), (second, 20.1)):
        books.answered(number, b"1", {"status": "done"}, now=at)
    books.answered(first, b"1", {"status": "done"}, now=10.2)
    books.link.broken(20.0)
    books.answered(second, b"1", {"status": "done"}, now=20.2)
    books.answered(second, b"2", {"status": "failed"}, now=20.3)
    assert (books.tally.contradicted, books.tally.told_again) == (2, 1)


def test_a_relay_that_a_command_switches_after_its_deadline_is_late() -> None:
    """2 s and the 3 s of the link check, or the deadline that the command brought."""
    for deadline_s, at, late in ((2.0, 15.2, 0), (2.0, 15.4, 1), (0.1, 13.5, 1), (9.0, 21.9, 0)):
        books = ledger()
        books.sent("s", {1: True}, 10.0, deadline_s)
        books.judge([switched(at, 1)], now=30.0)
        assert (books.tally.late, books.tally.wrong) == (late, 0)


def test_what_was_on_its_way_is_older_by_the_time_of_a_suspend() -> None:
    """A command that was on its way during a suspend is older by that time."""
    books = ledger()
    asleep = books.sent("s", {1: True}, now=10.0)
    books.sent("t", {1: True}, 10.0, 30.0)
    books.woke(12.0, slept_s=20.0)
    awake = books.sent("s", {4: True}, now=12.5)
    books.answered(asleep, b"1", {"status": "unknown"}, now=19.0)
    books.answered(awake, b"1", {"status": "done"}, now=13.0)
    moves = [switched(11.0, 1), switched(12.4, 1), switched(12.7, 4)]
    moves += [switched(at, 1)._replace(station_id="t") for at in (23.2, 23.4)]
    books.judge(moves, now=40.0)
    assert (books.tally.late, books.tally.wrong, books.tally.longest_s) == (2, 0, 0.5)


def test_what_a_command_allows_besides_is_taken_off_the_time_of_its_verdict() -> None:
    """A longer deadline of a command is subtracted from the time of its verdict."""
    books = ledger()
    number = books.sent("s", {1: True}, 10.0, 10.0)
    books.answered(number, b"1", {"status": "done"}, now=18.0)
    assert books.tally.longest_s == 0.0


def test_an_output_that_a_tool_made_a_pulse_is_judged_as_one() -> None:
    """Two frames for one command are two pulses, and a gap that is written ON is one."""
    books = ledger()
    books.sent("s", {1: True}, now=10.0)
    moves = [switched(10.1, 1), switched(10.3, 1, changed=False), switched(10.3, 4, changed=False)]
    books.judge([move._replace(pulse=True) for move in moves], now=20.0)
    assert (books.tally.twice, books.tally.wrong) == (1, 1)


def test_rules_of_the_configuration_are_counted_and_are_not_wrong() -> None:
    """`on_loss` when no ping came for its time, also where the bridge slept a part of it."""
    books = Ledger(Rules(on_loss=5, after_s=20.0))
    books.link.ping(10.0)
    books.link.broken(14.0)
    books.judge([switched(15.0, 5)], now=16.0)
    books.link.suspended(16.0, 17.0)
    books.link.ping(16.9)
    books.judge([switched(17.0, 5)], now=20.0)
    assert (books.tally.wrong, books.tally.own) == (1, {"on_loss": 1})


def test_a_link_with_two_troubles_is_whole_when_both_are_over() -> None:
    """The ping that tells comes after the second."""
    books = ledger()
    books.link.broken(10.0)
    books.link.broken(11.0)
    books.link.mended(12.0)
    books.link.ping(14.0)
    assert not books.link.whole
    books.link.mended(15.0)
    books.link.ping(16.5)
    assert books.link.whole


def test_a_suspend_alone_is_no_loss() -> None:
    """The broker was there before, and is there after it."""
    books = Ledger(Rules(on_loss=5, after_s=20.0))
    books.link.ping(10.0)
    books.link.suspended(12.0, 60.0)
    books.judge([switched(12.1, 5)], now=20.0)
    assert (books.tally.wrong, books.tally.own) == (1, {})
