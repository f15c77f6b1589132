"""What goes wrong on a simulated line, how often, and at which station."""

import random
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum


class FaultKind(StrEnum):
    """One kind of trouble; each but ECHO strikes requests to modules that are there."""

    DEAF = "deaf"  # the request is lost: not carried out, not answered
    SILENT = "silent"  # carried out, the reply is lost
    REFUSE = "refuse"  # not carried out: `ERR=3`, or Modbus exception 04
    LATE = "late"  # the reply comes `delay_s` later than it should
    FLIP = "flip"  # one bit of the reply, `bit` or any
    FLIP_REQUEST = "flip-request"  # one bit of the request, `bit` or any
    TRUNCATE = "truncate"  # the reply ends too soon
    DUPLICATE = "duplicate"  # the reply comes twice
    MERGE = "merge"  # the reply comes right in front of the next one
    NOISE = "noise"  # random bytes around the reply
    FLOOD = "flood"  # a great many random bytes in place of the reply
    ECHO = "echo"  # line-wide: the adapter returns what is sent first
    HANG_UP = "hang-up"  # the port goes away on a request, and comes back `delay_s` later


WISCO_WRITES = (b"WDO", b"WEE")
MODBUS_WRITES = (5, 6, 15, 16)
DEFAULT_DELAY_S = {FaultKind.LATE: 0.2, FaultKind.HANG_UP: 1.0}


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault that is on.

    Attributes:
        probability: How likely it strikes when it can.
        delay_s: For LATE and HANG_UP.
        bit: For FLIP and FLIP_REQUEST: which bit, counted from the least of the first byte;
            None: any.
        only: Which requests it can strike; None: all.
    """

    kind: FaultKind
    probability: float
    delay_s: float
    bit: int | None
    only: Callable[[bytes], bool] | None


def is_write(frame: bytes) -> bool:
    """Tell whether a request, of whichever protocol, is to change something."""
    if frame.startswith(b"#"):
        return frame[3:6] in WISCO_WRITES
    if frame.startswith(b":"):
        return frame[3:5] in [b"%02X" % code for code in MODBUS_WRITES]
    return frame[1] in MODBUS_WRITES


class Faults:
    """The faults of one line. Any thread may set them; the line's thread draws.

    Attributes:
        struck: How often each kind has struck.
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
        station: int | None = None,
        probability: float = 1.0,
        times: int | None = None,
        delay_s: float | None = None,
        bit: int | None = None,
        only: Callable[[bytes], bool] | None = None,
    ) -> None:
        """Put a fault on, for one station or the whole line; `times`: it strikes so often.

        `only=is_write` lets the polls go by unharmed.
        """
        kind = FaultKind(kind)
        if kind is FaultKind.ECHO and station is not None:
            raise ValueError("echo is the adapter's: it is for the whole line, not for a station")
        if not 0 <= probability <= 1:
            raise ValueError(f"a probability is from 0 to 1, not {probability}")
        delay_s = DEFAULT_DELAY_S.get(kind, 0.0) if delay_s is None else delay_s
        with self._lock:
            self._on[kind, station] = Fault(kind, probability, delay_s, bit, only)
            self._left.pop((kind, station), None)
            if times is not None:
                self._left[kind, station] = times

    def clear(self, kind: FaultKind | str | None = None, *, station: int | None = None) -> None:
        """Take off one fault as it was set, or without `kind` all of them."""
        with self._lock:
            keys = list(self._on) if kind is None else [(FaultKind(kind), station)]
            for key in keys:
                self._on.pop(key, None)
                self._left.pop(key, None)

    def draw(self, kind: FaultKind, frame: bytes, station: int | None = None) -> Fault | None:
        """Tell whether a fault strikes this request, at this station."""
        if not self._on:  # the hot path of a healthy line
            return None
        with self._lock:
            # dict.fromkeys: for the whole line both keys are one, which draws once.
            for key in dict.fromkeys(((kind, station), (kind, None))):
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
        """Turn one bit over: `bit`, or any."""
        bit = self._chance.randrange(8 * len(data)) if bit is None else bit % (8 * len(data))
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        return bytes(flipped)

    def cut(self, data: bytes) -> bytes:
        """Leave out at least the last byte, at most all but one."""
        return data[: self._chance.randrange(1, len(data))]

    def noise(self, least: int, most: int) -> bytes:
        """Random bytes."""
        return self._chance.randbytes(self._chance.randint(least, most))
