"""The faults of a simulated line: their kind, probability and station."""

import random
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum


class FaultKind(StrEnum):
    """A kind of fault. All but ECHO affect requests to modules that are present."""

    DEAF = "deaf"  # the request is lost: not carried out, not answered
    SILENT = "silent"  # carried out, the reply is lost
    REFUSE = "refuse"  # not carried out: `ERR=3`, or Modbus exception 04
    LATE = "late"  # the reply comes `delay_s` later than it should
    FLIP = "flip"  # one bit of the reply, `bit` or any
    FLIP_REQUEST = "flip-request"  # one bit of the request, `bit` or any
    TRUNCATE = "truncate"  # the reply ends too soon
    DUPLICATE = "duplicate"  # the reply comes twice
    MERGE = "merge"  # the reply comes directly before the next one
    NOISE = "noise"  # random bytes around the reply
    FLOOD = "flood"  # a great many random bytes in place of the reply
    ECHO = "echo"  # whole line: the adapter echoes the request first
    HANG_UP = "hang-up"  # the port goes away on a request, and comes back `delay_s` later


WISCO_WRITES = (b"WDO", b"WEE")
MODBUS_WRITES = (5, 6, 15, 16)
DEFAULT_DELAY_S = {FaultKind.LATE: 0.2, FaultKind.HANG_UP: 1.0}


@dataclass(frozen=True, slots=True)
class Fault:
    """An active fault.

    Attributes:
        probability: The probability for each request.
        delay_s: For LATE and HANG_UP.
        bit: For FLIP and FLIP_REQUEST: the bit, counted from the lowest of the first byte; None:
            any.
        only: A test of the requests that it affects; None: all.
    """

    kind: FaultKind
    probability: float
    delay_s: float
    bit: int | None
    only: Callable[[bytes], bool] | None


def is_write(frame: bytes) -> bool:
    """Return whether a request of any protocol is a write."""
    if frame.startswith(b"#"):
        return frame[3:6] in WISCO_WRITES
    if frame.startswith(b":"):
        return frame[3:5] in [b"%02X" % code for code in MODBUS_WRITES]
    return frame[1] in MODBUS_WRITES


class Faults:
    """The faults of one line. Any thread may set them; the thread of the line draws.

    Attributes:
        struck: How often each kind has occurred.
    """

    def __init__(self, chance: random.Random) -> None:
        self.struck: Counter[FaultKind] = Counter()
        self._chance = chance
        self._lock = threading.Lock()
        self._on: dict[tuple[FaultKind, int | None], Fault] = {}
        self._left: dict[tuple[FaultKind, int | None], int] = {}

    def set(
        self,
        kind: FaultKind | str,
        *,
        address: int | None = None,
        probability: float = 1.0,
        times: int | None = None,
        delay_s: float | None = None,
        bit: int | None = None,
        only: Callable[[bytes], bool] | None = None,
    ) -> None:
        """Begin a fault, for one station or the whole line; it ends after `times` occurrences.

        With `only=is_write` polls are not affected.
        """
        kind = FaultKind(kind)
        if kind is FaultKind.ECHO and address is not None:
            raise ValueError("echo is the adapter's: it is for the whole line, not for a station")
        if not 0 <= probability <= 1:
            raise ValueError(f"a probability is from 0 to 1, not {probability}")
        delay_s = DEFAULT_DELAY_S.get(kind, 0.0) if delay_s is None else delay_s
        with self._lock:
            self._on[kind, address] = Fault(kind, probability, delay_s, bit, only)
            self._left.pop((kind, address), None)
            if times is not None:
                self._left[kind, address] = times

    def clear(self, kind: FaultKind | str | None = None, *, address: int | None = None) -> None:
        """End one fault, or without `kind` all of them."""
        with self._lock:
            keys = list(self._on) if kind is None else [(FaultKind(kind), address)]
            for key in keys:
                self._on.pop(key, None)
                self._left.pop(key, None)

    def draw(self, kind: FaultKind, frame: bytes, address: int | None = None) -> Fault | None:
        """Return the fault that affects this request at this station; None: no fault."""
        if not self._on:  # the hot path of a healthy line
            return None
        with self._lock:
            # dict.fromkeys: for the whole line both keys are equal, and it is drawn once.
            for key in dict.fromkeys(((kind, address), (kind, None))):
                if (fault := self._on.get(key)) and self._strikes(key, fault, frame):
                    self.struck[kind] += 1
                    return fault
        return None

    def _strikes(self, key: tuple[FaultKind, int | None], fault: Fault, frame: bytes) -> bool:
        left = self._left.get(key)
        if left == 0 or (fault.only and not fault.only(frame)):
            return False
        if self._chance.random() >= fault.probability:
            return False
        if left is not None:
            self._left[key] = left - 1
        return True

    def flip(self, data: bytes, bit: int | None) -> bytes:
        """Return the data with one bit flipped: `bit`, or any."""
        bit = self._chance.randrange(8 * len(data)) if bit is None else bit % (8 * len(data))
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        return bytes(flipped)

    def cut(self, data: bytes) -> bytes:
        """Return the data without at least its last byte; at least one byte stays."""
        return data[: self._chance.randrange(1, len(data))]

    def noise(self, least: int, most: int) -> bytes:
        """Return random bytes."""
        return self._chance.randbytes(self._chance.randint(least, most))
