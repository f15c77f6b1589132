"""Decides in which order the motors of a line are stopped, and when that is given up.

docs/contract.md, promise 4: modules that answer come before silent ones, and each is tried. It sees
neither port nor frame. Time comes in as an argument: monotonic seconds.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum

from bridge.model import bit, channels_of

# From when the stop was asked for: then the line ends, whatever still runs.
BUDGET_S = 6.0
# A module that was tried in vain is tried again until then, one that was not to the end.
PATIENCE_S = 3.0
AGAIN_S = 0.25  # after an attempt in vain
REOPEN_S = 0.2  # a port that is gone is opened again so often


class Act(Enum):
    """Describe what is done to one module."""

    MEET = "met by reads: it was away, or its port was"
    OFF = "told to switch its motors OFF"
    LOOK = "read, to see whether it did"


@dataclass(frozen=True, slots=True)
class Moving:
    """A module of which a motor may run.

    Attributes:
        station: Its address.
        met: It was met as a stranger, and not lost since: it may be written.
        answers: It answered its last exchange.
        heard_at: When it last answered a read.
    """

    station: int
    met: bool
    answers: bool
    heard_at: float


@dataclass(frozen=True, slots=True)
class Step:
    """Describe what is next."""

    station: int
    act: Act


@dataclass(frozen=True, slots=True)
class Pause:
    """Nothing is to be done before `until`."""

    until: float


class Halt:
    """The stop of one line, from when it was asked for.

    Each module that answers is told OFF, then each of them is read, then the silent ones follow.
    What fails is tried again behind those that were not tried yet.
    """

    def __init__(self, asked_at: float) -> None:
        self._over_at = asked_at + BUDGET_S
        self._patient_until = asked_at + PATIENCE_S
        self._told: set[int] = set()  # they took OFF, and were not read since
        self._failed_at: dict[int, float] = {}

    def next(self, moving: Iterable[Moving], now: float) -> Step | Pause | None:
        """Return the next step, or how long there is none; None: it is over."""
        if now >= self._over_at:
            return None
        wanted = [module for module in moving if self._is_wanted(module, now)]
        if not wanted:
            return None
        ready = [module for module in wanted if self._free_at(module) <= now]
        if not ready:
            return Pause(min(*map(self._free_at, wanted), self._over_at))
        first = min(ready, key=self._rank)
        return Step(first.station, self._act(first))

    def met(self, station: int) -> None:
        """Note that it answered, and is what it should be."""
        self._failed_at.pop(station, None)

    def told(self, station: int) -> None:
        """Note that it took OFF."""
        self._failed_at.pop(station, None)
        self._told.add(station)

    def failed(self, station: int, now: float) -> None:
        """It gave no valid answer, or it answered and did not do it."""
        self._told.discard(station)
        self._failed_at[station] = now

    def port_lost(self) -> None:
        """Note that every module is to be met anew, and tried anew."""
        self._told.clear()
        self._failed_at.clear()

    def _is_wanted(self, module: Moving, now: float) -> bool:
        return module.station not in self._failed_at or now < self._patient_until

    def _free_at(self, module: Moving) -> float:
        failed_at = self._failed_at.get(module.station)
        return 0.0 if failed_at is None else failed_at + AGAIN_S

    def _rank(self, module: Moving) -> tuple[bool, float, bool, float]:
        """Of those that were not tried, the one that was heard last: it is likeliest to answer."""
        failed_at = self._failed_at.get(module.station, 0.0)
        return not module.answers, failed_at, module.station in self._told, -module.heard_at

    def _act(self, module: Moving) -> Act:
        if not module.met:
            return Act.MEET
        return Act.LOOK if module.station in self._told else Act.OFF


def off_masks(off: int, ours: int) -> Iterator[int]:
    """Split the outputs `off` into ranges that hold none but `ours`: each is one write.

    What lies between two of them is written OFF as well, so it has to belong to a cover too.
    """
    run = 0
    for channel in range(1, ours.bit_length() + 2):
        if ours & bit(channel):
            run |= bit(channel)
        elif run:
            if run & off:
                yield _filled(run & off)
            run = 0


def _filled(outputs: int) -> int:
    """Return all outputs from the lowest to the highest of these."""
    first, last = min(channels_of(outputs)), max(channels_of(outputs))
    return sum(map(bit, range(first, last + 1)))
