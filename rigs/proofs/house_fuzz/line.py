"""A line of the house on the clockwork: by exchanges (fast), or byte by byte (the real bus)."""

import random
from collections import deque
from collections.abc import Callable
from typing import Any

from support.bus_worker import BusLine
from support.virtual_line import Fault, VirtualLine

from bridge.config.schema import LineConfig
from bridge.simulator.faults import FaultKind, is_write
from proofs.house_fuzz.clockwork import Clockwork

FRAMES_KEPT = 40
FLIP_PAUSE_S = 4.0  # two flips of one bit in a row would be a state twice read (promise 5)
_FAULTS = (
    Fault.LOSE_REQUEST,
    Fault.LOSE_REPLY,
    Fault.GARBLE_REPLY,
    Fault.FLIP_REPLY,
    Fault.REFUSE,
    Fault.IGNORE,
)
_BUS_FAULTS: tuple[tuple[FaultKind, dict[str, float]], ...] = (
    (FaultKind.DEAF, {}),
    (FaultKind.SILENT, {}),
    (FaultKind.TRUNCATE, {}),
    (FaultKind.LATE, {"delay_s": 0.2}),
    (FaultKind.LATE, {"delay_s": 0.12}),
    (FaultKind.NOISE, {}),
    (FaultKind.REFUSE, {}),
)

Sent = Callable[[float, bytes], None]


class WireLog(deque[tuple[float, bytes]]):
    """Keeps the last frames, and tells of each that goes out."""

    def __init__(self, sent: Sent) -> None:
        super().__init__(maxlen=FRAMES_KEPT)
        self.sent = sent
        self.total = 0

    def append(self, item: tuple[float, bytes]) -> None:
        """Take one frame."""
        super().append(item)
        self.total += 1
        if is_write(item[1]):
            self.sent(*item)


class _OnClockwork(VirtualLine):
    """Time is the clockwork's."""

    clockwork: Clockwork

    @property
    def now(self) -> float:
        """The instant."""
        return self.clockwork.now

    @now.setter
    def now(self, _instant: float) -> None:
        """Nobody sets it."""

    def advance(self, until: float) -> None:
        """Let time pass for the thread of this line."""
        self.clockwork.wait(until - self.clockwork.now)

    def next_action_at(self) -> float:
        """Nothing is to be done that the clockwork does not know."""
        return float("inf")


class FastLine(_OnClockwork):
    """Exchanges without bytes in between.

    Attributes:
        rate: How likely a fault strikes one exchange.
        trouble: Told of each fault.
    """

    def __init__(
        self, clockwork: Clockwork, config: LineConfig, chance: random.Random, sent: Sent
    ) -> None:
        self.clockwork = clockwork
        super().__init__(config)
        self.wire: Any = WireLog(sent)
        self.rate = 0.0
        self.trouble: Callable[[], None] = lambda: None
        self._chance = chance
        self._flipped_at = 0.0
        self._hang_up = False
        self.fault = self._strike

    def hang_up(self) -> None:
        """Let the port be gone at the next exchange."""
        self._hang_up = True

    def set_rate(self, rate: float) -> None:
        """Let so many exchanges fail."""
        self.rate = rate

    def _strike(self, frame: bytes) -> Fault | None:
        if self._hang_up:
            self._hang_up = False
            self.trouble()
            return self._chance.choice((Fault.PORT_GONE, Fault.PORT_GONE_AFTER))
        if not self.rate or self._chance.random() >= self.rate:
            return None
        fault = self._chance.choice(_FAULTS)
        if fault is Fault.IGNORE and not is_write(frame):
            return None
        if fault is Fault.FLIP_REPLY:
            if self.now - self._flipped_at < FLIP_PAUSE_S:
                return None
            self._flipped_at = self.now
        self.trouble()
        return fault


class ByteLine(_OnClockwork, BusLine):
    """The real bus, and the modules' side of the conversation."""

    def __init__(
        self, clockwork: Clockwork, config: LineConfig, chance: random.Random, sent: Sent
    ) -> None:
        self.clockwork = clockwork
        super().__init__(config, seed=chance.randrange(1 << 30))
        self.wire: Any = WireLog(sent)
        self.trouble: Callable[[], None] = lambda: None

    def hang_up(self) -> None:
        """Let the port be gone at the next exchange."""
        self.faults.set(FaultKind.HANG_UP, times=1)

    def set_rate(self, rate: float) -> None:
        """Let so many exchanges fail."""
        for kind, extra in _BUS_FAULTS:
            if rate:
                self.faults.set(kind, probability=rate / len(_BUS_FAULTS), **extra)  # type: ignore[arg-type]
            else:
                self.faults.clear(kind)

    @property
    def rate(self) -> float:
        """Not known: the faults draw."""
        return 0.0


Line = FastLine | ByteLine
