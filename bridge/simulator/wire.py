"""The time of bytes on the wire, and a bounded record of them."""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Self

from bridge.model import LineProtocol

BITS_PER_CHAR = 10  # 1 start, 8 data, 1 stop (docs/protocol.md section 1)
SILENCE_CHARS = 3.5
FIXED_SILENCE_S = 0.00175  # above 19200 baud (docs/protocol.md section 5)
FIXED_SILENCE_ABOVE = 19200
ENTRIES_KEPT = 10_000


@dataclass(frozen=True, slots=True)
class Pace:
    """The times of a line and its modules, in seconds."""

    char_s: float
    silence_s: float  # after this silence a module takes a request as complete
    turnaround_s: float

    @classmethod
    def of(cls, protocol: LineProtocol, baud: int, turnaround_s: float, *, paced: bool) -> Self:
        """Return the pace of a real line; without `paced` bytes take no time."""
        if not paced:
            return cls(0.0, 0.0, turnaround_s)
        char_s = BITS_PER_CHAR / baud
        if protocol is not LineProtocol.MODBUS_RTU:
            return cls(char_s, 0.0, turnaround_s)
        silence_s = FIXED_SILENCE_S if baud > FIXED_SILENCE_ABOVE else SILENCE_CHARS * char_s
        return cls(char_s, silence_s, turnaround_s)


class Direction(StrEnum):
    """The direction of bytes."""

    TO_MODULES = ">"
    TO_MASTER = "<"


class WireEntry(NamedTuple):
    """Bytes that passed at one instant of `time.monotonic()`."""

    at: float
    direction: Direction
    data: bytes


class WireLog:
    """The last entries. Append and copy of a deque are atomic, so there is no lock."""

    def __init__(self) -> None:
        self._entries: deque[WireEntry] = deque(maxlen=ENTRIES_KEPT)

    def add(self, at: float, direction: Direction, data: bytes) -> None:
        """Record bytes."""
        self._entries.append(WireEntry(at, direction, data))

    def entries(self) -> tuple[WireEntry, ...]:
        """Return the entries, oldest first."""
        return tuple(self._entries.copy())
