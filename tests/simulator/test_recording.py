"""A transcript that answers: each request gets what followed it in the record."""

from pathlib import Path

from support.line_master import LineMaster
from support.tapped_line import TAP, tapped_line

from bridge.model import DIO100, LineProtocol
from bridge.simulator import SimulatedLine, SimulatedModule
from bridge.simulator.recording import Recording
from bridge.transcript import Entry

ASK, OTHER = b"#01RDIH\r", b"#02RDOH\r"


def recording(*pieces: tuple[str, bytes]) -> Recording:
    """Makes one of directions and bytes."""
    return Recording([Entry(float(at), way, data) for at, (way, data) in enumerate(pieces)])


def test_answers_come_in_their_order_and_the_last_stays() -> None:
    """Answers come in their order and the last one repeats, however requests are mixed."""
    answers = recording((">", ASK), ("<", b"a"), (">", OTHER), ("<", b"x"), (">", ASK), ("<", b"b"))
    assert [answers.answer(ASK, now) for now in (50.0, 60.0, 70.0)] == [b"a", b"b", b"b"]
    assert answers.answer(OTHER, 70.0) == b"x"


def test_no_answer_comes_sooner_than_it_came_in_the_record() -> None:
    """The second was asked for 2 s after the first."""
    answers = recording((">", ASK), ("<", b"a"), (">", ASK), ("<", b"b"))
    assert [answers.answer(ASK, now) for now in (50.0, 51.9, 52.0)] == [b"a", b"a", b"b"]


def test_who_asks_less_often_misses_no_change() -> None:
    """Each answer that differs comes, as often as a reader wants to see it who reads twice."""
    five = [
        piece for answer in (b"a", b"b", b"b", b"b", b"a") for piece in ((">", ASK), ("<", answer))
    ]
    answers = recording(*five)
    assert [answers.answer(ASK, 50.0 + 20 * n) for n in range(5)] == [b"a", b"b", b"b", b"a", b"a"]


def test_what_was_not_answered_is_not_answered() -> None:
    """A silence of the record is one of the replay, and an unknown request gets none either."""
    answers = recording((">", ASK), (">", ASK), ("<", b"a"))
    assert [answers.answer(ASK, 0.0), answers.answer(ASK, 9.0)] == [b"", b"a"]
    assert answers.answer(b"?", 9.0) == b""


def test_noise_is_part_of_an_answer_and_none_before_the_first_request() -> None:
    """Damaged replies come back as damaged."""
    answers = recording(("?", b"z"), (">", ASK), ("?", b"\xff"), ("<", b"a"))
    assert answers.answer(ASK, 0.0) == b"\xffa"


def test_a_request_at_the_very_end_proves_nothing() -> None:
    """The record was ended before its answer."""
    answers = recording((">", ASK), ("<", b"a"), (">", ASK))
    assert [answers.answer(ASK, now) for now in (0.0, 9.0)] == [b"a", b"a"]


def test_a_line_answers_from_a_record() -> None:
    """On the wire, at the pace of the wire."""
    line = SimulatedLine(
        LineProtocol.WISCO, 57600, [], recording=recording((">", ASK), ("<", b"DI>9EAB\r"))
    )
    with line, LineMaster(line.port) as master:
        assert master.ask(ASK, 8) == b"DI>9EAB\r"


def test_a_tap_hears_both_directions(tmp_path: Path) -> None:
    """The tap receives both directions, and an unread tap does not block the line."""
    with tapped_line(tmp_path, LineProtocol.WISCO, SimulatedModule(DIO100, 1), paced=False) as line:
        with LineMaster(line.port) as master:
            for _ in range(1000):  # more than a pty holds
                assert master.ask(ASK, 8) == b"DI>0000\r"
        with LineMaster(str(tmp_path / TAP)) as tap:
            assert tap.receive(16) == ASK + b"DI>0000\r"
    assert not (tmp_path / TAP).is_symlink()
