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
    """However the requests of other stations lie between."""
    answers = recording((">", ASK), ("<", b"a"), (">", OTHER), ("<", b"x"), (">", ASK), ("<", b"b"))
    assert [answers.answer(ASK) for _ in range(3)] == [b"a", b"b", b"b"]
    assert answers.answer(OTHER) == b"x"


def test_what_was_not_answered_is_not_answered() -> None:
    """A silence of the record is one of the replay, and an unknown request gets none either."""
    answers = recording((">", ASK), (">", ASK), ("<", b"a"))
    assert [answers.answer(ASK), answers.answer(ASK), answers.answer(b"?")] == [b"", b"a", b""]


def test_noise_is_part_of_an_answer_and_none_before_the_first_request() -> None:
    """Damaged replies come back as damaged."""
    answers = recording(("?", b"z"), (">", ASK), ("?", b"\xff"), ("<", b"a"))
    assert answers.answer(ASK) == b"\xffa"


def test_a_request_at_the_very_end_proves_nothing() -> None:
    """The record was ended before its answer."""
    answers = recording((">", ASK), ("<", b"a"), (">", ASK))
    assert [answers.answer(ASK), answers.answer(ASK)] == [b"a", b"a"]


def test_a_line_answers_from_a_record() -> None:
    """On the wire, at the pace of the wire."""
    line = SimulatedLine(
        LineProtocol.WISCO, 57600, [], recording=recording((">", ASK), ("<", b"DI>9EAB\r"))
    )
    with line, LineMaster(line.port) as master:
        assert master.ask(ASK, 8) == b"DI>9EAB\r"


def test_a_tap_hears_both_directions(tmp_path: Path) -> None:
    """And who does not listen holds up nobody."""
    with tapped_line(tmp_path, LineProtocol.WISCO, SimulatedModule(DIO100, 1), paced=False) as line:
        with LineMaster(line.port) as master:
            for _ in range(1000):  # more than a pty holds
                assert master.ask(ASK, 8) == b"DI>0000\r"
        with LineMaster(str(tmp_path / TAP)) as tap:
            assert tap.receive(16) == ASK + b"DI>0000\r"
    assert not (tmp_path / TAP).is_symlink()
