"""Decides the order in which the motors of a line are stopped, and when to give up.

docs/contract.md, promise 4: modules that answer come before silent ones, and each is tried. It uses
neither port nor frames. Time is an argument (`bridge.clock.boot_s`).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum

from bridge.model import bit, channels_of

# From the request to stop: then the line ends, even if a motor still runs.
BUDGET_S = 6.0
# Until then failed modules are tried again; modules that were not tried yet, until the end.
PATIENCE_S = 3.0
AGAIN_S = 0.25  # after a failed attempt
REOPEN_S = 0.2  # how often a lost port is opened again


class Act(Enum):
    """The action at one module."""

    MEET = "met by reads: it was away, or its port was"
    OFF = "told to switch its motors OFF"
    LOOK = "read, to see whether it did"


@dataclass(frozen=True, slots=True)
class Moving:
    """A module with a motor that may run.

    Attributes:
        address: Its address.
        met: It was contacted and not lost since, so it may be written.
        answers: It answered its last exchange.
        heard_at: When it last answered a read.
    """

    address: int
    met: bool
    answers: bool
    heard_at: float


@dataclass(frozen=True, slots=True)
class Step:
    """The next action, and its module."""

    address: int
    act: Act


@dataclass(frozen=True, slots=True)
class Pause:
    """Nothing is to be done before `until`."""

    until: float


class Halt:
    """The stop of one line, from the request on.

    First each answering module gets OFF, then each of them is read, then the silent ones follow.
    Failed modules are tried again after those that were not tried yet.
    """

    def __init__(self, asked_at: float) -> None:
        self._over_at = asked_at + BUDGET_S
        self._patient_until = asked_at + PATIENCE_S
        self._told: set[int] = set()  # they accepted OFF, and were not read since
        self._failed_at: dict[int, float] = {}

    def next(self, moving: Iterable[Moving], now: float) -> Step | Pause | None:
        """Return the next step, or a pause; None: it is over."""
        if now >= self._over_at:
            return None
        wanted = [module for module in moving if self._is_wanted(module, now)]
        if not wanted:
            return None
        ready = [module for module in wanted if self._free_at(module) <= now]
        if not ready:
            return Pause(min(*map(self._free_at, wanted), self._over_at))
        first = min(ready, key=self._rank)
        return Step(first.address, self._act(first))

    def met(self, address: int) -> None:
        """Record that a module answered, and has the right model."""
        self._failed_at.pop(address, None)

    def told(self, address: int) -> None:
        """Record that a module accepted OFF."""
        self._failed_at.pop(address, None)
        self._told.add(address)

    def failed(self, address: int, now: float) -> None:
        """Record that a module gave no valid answer, or answered but did not obey."""
        self._told.discard(address)
        self._failed_at[address] = now

    def port_lost(self) -> None:
        """Begin again with every module: the port was lost."""
        self._told.clear()
        self._failed_at.clear()

    def _is_wanted(self, module: Moving, now: float) -> bool:
        return module.address not in self._failed_at or now < self._patient_until

    def _free_at(self, module: Moving) -> float:
        failed_at = self._failed_at.get(module.address)
        return 0.0 if failed_at is None else failed_at + AGAIN_S

    def _rank(self, module: Moving) -> tuple[bool, float, bool, float]:
        """Return the sort key: answering, not tried yet, still to be switched, last heard."""
        failed_at = self._failed_at.get(module.address, 0.0)
        return not module.answers, failed_at, module.address in self._told, -module.heard_at

    def _act(self, module: Moving) -> Act:
        if not module.met:
            return Act.MEET
        return Act.LOOK if module.address in self._told else Act.OFF


def off_masks(off: int, ours: int) -> Iterator[int]:
    """Yield ranges for the outputs `off`; each range has only outputs in `ours`, and is one write.

    Outputs inside a range are written OFF too, so they must belong to a cover as well.
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
    """Return all outputs from the lowest to the highest."""
    first, last = min(channels_of(outputs)), max(channels_of(outputs))
    return sum(map(bit, range(first, last + 1)))
