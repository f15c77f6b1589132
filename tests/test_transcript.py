"""Transcripts: what is written is read, and what cannot be read is named with its line."""

from pathlib import Path

import pytest

from bridge.errors import BridgeError
from bridge.model import LineProtocol
from bridge.transcript import Entry, Transcript, format_entry, format_header, load_transcript

ENTRIES = (Entry(0.0, ">", b"#01RDI\r"), Entry(0.5, "<", b"\x00\xff"), Entry(70.0, "?", b"\x0a"))


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """Times, directions and bytes; notes are for people."""
    path = tmp_path / "line.txt"
    text = format_header("baud", "9600") + format_header("protocol", "wisco")
    path.write_text(text + "".join(format_entry(entry, "# 1 [noise] > 00") for entry in ENTRIES))
    assert load_transcript(path) == Transcript(LineProtocol.WISCO, 9600, ENTRIES)


def test_a_file_written_by_hand_is_read(tmp_path: Path) -> None:
    """No header, blank lines, comments, lower case."""
    path = tmp_path / "line.txt"
    path.write_text("# mine\n\n0 > 0a ff\n1.5 < 00 # note\n")
    entries = (Entry(0.0, ">", b"\x0a\xff"), Entry(1.5, "<", b"\x00"))
    assert load_transcript(path) == Transcript(None, None, entries)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("0 > 0\n", "line 1: write seconds"),
        ("0 > 00\n1 - 00\n", "line 2: write seconds"),
        ("# hello\n", "nothing passed in it"),
        ("# protocol: modbus\n0 > 00\n", "there is no protocol modbus; write one of wisco"),
        ("# baud: 300\n0 > 00\n", "baud 300 is none of 4800"),
    ],
)
def test_what_cannot_be_read_is_named(text: str, complaint: str, tmp_path: Path) -> None:
    """The message begins with the file."""
    path = tmp_path / "line.txt"
    path.write_text(text)
    with pytest.raises(BridgeError, match=rf"line\.txt: {complaint}"):
        load_transcript(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    """One line."""
    with pytest.raises(BridgeError, match=r"gone\.txt cannot be read: No such file"):
        load_transcript(tmp_path / "gone.txt")
