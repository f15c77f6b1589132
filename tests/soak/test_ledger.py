from bridge.simulator.module import Switching
from soak.ledger import Ledger
from soak.relays import Move, Rules

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
        switched(10.1, 1)._replace(station="t"),
    ):
        books = ledger()
        number = books.sent("s", {1: True}, now=10.0)
        books.answered(number, b"1", {"status": "done"}, now=10.2)
        books.judge([stray], now=20.0)
        assert books.tally.wrong == 1


def test_gaps_that_are_written_as_they_were_and_ends_of_pulses_are_not_wrong() -> None:
    """They switch nothing that somebody would have to ask for."""
    books = ledger()
    pulse_end = Switching(10.1, PULSE, value=False, frame=b"", changed=True)
    books.judge([switched(10.1, 3, changed=False), Move("s", pulse_end)], now=20.0)
    assert books.tally.wrong == 0


def test_a_second_pulse_for_one_command_is_counted() -> None:
    """Even one that comes while the first runs, and so changes nothing."""
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
    """Not to one that waited beside it and was lost on its way, nor to one that was refused."""
    books = ledger()
    lost, refused, done = (books.sent("s", {PULSE: True}, now=10.0 + n / 10) for n in range(3))
    books.answered(done, b"1", {"status": "done"}, now=10.5)
    books.answered(lost, b"2", {"status": "unknown"}, now=11.0)
    books.answered(refused, b"3", {"status": "refused"}, now=11.0)
    books.judge([switched(10.4, PULSE)], now=300.0)
    assert (books.tally.not_sent, books.tally.twice, books.tally.wrong) == (0, 0, 0)


def test_a_refused_command_explains_no_relay() -> None:
    """It was never sent, so whatever switched was another's doing."""
    books = ledger()
    number = books.sent("s", {1: True}, now=10.0)
    books.answered(number, b"1", {"status": "refused"}, now=11.0)
    books.judge([switched(10.4, 1)], now=20.0)
    assert books.tally.wrong == 1


def test_a_command_without_a_verdict_is_missing_unless_the_link_was_cut() -> None:
    """What was sent from 3 s before a cut until the bridge was heard again may be lost."""
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
