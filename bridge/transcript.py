"""The text form of what passed on a line: written by `monitor`, replayed by `simulate`.

```
# baud: 9600
# protocol: modbus-rtu
    0.000000 > 01 02 00 00 00 10 79 C6  # 1 read inputs 1-16
    0.021340 < 01 02 02 AB 9E 47 20  # 1 inputs ON: 1, 2, 4
    1.500000 ? FF 00  # noise
```

The columns: seconds since the first entry; `>` to the modules, `<` from them, `?` unknown; the
bytes in hex. Text after `#` is a comment, except for the two lines with protocol and baud rate.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from bridge.errors import BridgeError
from bridge.files import read_file
from bridge.model import BAUD_RATES, LineProtocol

_ENTRY = re.compile(
    r" *(?P<at>\d+(?:\.\d+)?) (?P<way>[<>?]) (?P<data>[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2})*) *(?:#.*)?"
)
_HEADER = re.compile(r"# (protocol|baud): (\S+)")
_MOST_BYTES = 256 * 2**20  # days of recording, and less than the memory of a small computer


@dataclass(frozen=True, slots=True)
class Entry:
    """One piece, `at` seconds after the first."""

    at: float
    way: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Transcript:
    """A whole file. None: not given, for example if a line spoke two protocols."""

    protocol: LineProtocol | None
    baud: int | None
    entries: tuple[Entry, ...]


def format_header(key: str, value: str) -> str:
    """Return a header line that the reader needs: `protocol` or `baud`."""
    return f"# {key}: {value}\n"


def format_entry(entry: Entry, note: str) -> str:
    """Return the line of one entry."""
    return f"{entry.at:12.6f} {entry.way} {entry.data.hex(' ').upper()}  # {note}\n"


def load_transcript(path: Path) -> Transcript:
    """Load a transcript.

    Raises:
        BridgeError: It cannot be read, or is not a transcript; with the line.
    """
    try:
        text = read_file(path, _MOST_BYTES).decode(errors="replace")
    except OSError as error:
        raise BridgeError(f"{path} cannot be read: {error.strerror}") from error
    try:
        return _parse(text.splitlines())
    except ValueError as error:
        raise BridgeError(f"{path}: {error}") from error


def _parse(lines: list[str]) -> Transcript:
    header = {found[1]: found[2] for line in lines if (found := _HEADER.fullmatch(line))}
    entries = tuple(_entries(lines))
    if not entries:
        raise ValueError("nothing passed in it; it is no transcript of monitor --record")
    return Transcript(_protocol(header.get("protocol")), _baud(header.get("baud")), entries)


def _entries(lines: Iterable[str]) -> Iterator[Entry]:
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        found = _ENTRY.fullmatch(line.rstrip())
        if found is None:
            raise ValueError(f"line {number}: write seconds, one of > < ?, and bytes in hex")
        yield Entry(float(found["at"]), found["way"], bytes.fromhex(found["data"]))


def _protocol(word: str | None) -> LineProtocol | None:
    if word is not None and word not in list(LineProtocol):
        raise ValueError(f"there is no protocol {word}; write one of {', '.join(LineProtocol)}")
    return LineProtocol(word) if word else None


def _baud(word: str | None) -> int | None:
    if word is not None and word not in map(str, BAUD_RATES):
        raise ValueError(f"baud {word} is none of {', '.join(map(str, BAUD_RATES))}")
    return int(word) if word else None
