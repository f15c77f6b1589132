"""Actions of a person or a scenario on simulated lines while they run."""

from dataclasses import dataclass
from enum import StrEnum

from bridge.simulator.faults import FaultKind
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule


class InputWord(StrEnum):
    """The change of an input."""

    ON = "ON"
    OFF = "OFF"
    TOGGLE = "TOGGLE"


@dataclass(frozen=True, slots=True)
class DriveInput:
    """Set one input of a module."""

    module: SimulatedModule
    channel: int
    word: InputWord

    def do(self) -> None:
        """Do it."""
        if self.word is InputWord.TOGGLE:
            self.module.toggle_input(self.channel)
        else:
            self.module.set_input(self.channel, self.word is InputWord.ON)


@dataclass(frozen=True, slots=True)
class MoveModule:
    """Take a module off its line, or put it back."""

    module: SimulatedModule
    away: bool

    def do(self) -> None:
        """Do it."""
        self.module.away = self.away


@dataclass(frozen=True, slots=True)
class PutFault:
    """Begin a fault at one station, or (None) at the whole line."""

    line: SimulatedLine
    kind: FaultKind
    address: int | None
    probability: float
    times: int | None
    delay_s: float | None

    def do(self) -> None:
        """Do it."""
        self.line.faults.set(
            self.kind,
            address=self.address,
            probability=self.probability,
            times=self.times,
            delay_s=self.delay_s,
        )


@dataclass(frozen=True, slots=True)
class TakeFault:
    """End a fault."""

    line: SimulatedLine
    kind: FaultKind
    address: int | None

    def do(self) -> None:
        """Do it."""
        self.line.faults.clear(self.kind, address=self.address)


Action = DriveInput | MoveModule | PutFault | TakeFault
