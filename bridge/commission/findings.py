"""What a scan found, as frozen values."""

from dataclasses import dataclass

from bridge.dip import switches_for
from bridge.model import LineProtocol, ModuleType, OutputSettings


@dataclass(frozen=True, slots=True)
class Found:
    """A module that answered, and whose answers can be believed.

    Attributes:
        protocols: What it answers; a line is configured with the first of them.
        settings: Its modes and hold times; None: it takes no Modbus frames, or did not say.
        damaged: How many of its replies were damaged.
        asked: How many were asked for.
    """

    station: int
    model: ModuleType
    baud: int
    protocols: tuple[LineProtocol, ...]
    settings: OutputSettings | None
    damaged: int
    asked: int

    @property
    def protocol(self) -> LineProtocol:
        """What a line with this module is configured as."""
        return self.protocols[0]

    @property
    def switches(self) -> tuple[bool, ...]:
        """Where its DIP switches stand, as far as answers tell."""
        return switches_for(self.station, self.baud, self.protocol)


@dataclass(frozen=True, slots=True)
class Clash:
    """An address whose answers come, and make no sense: two modules, as a rule.

    Attributes:
        evidence: Some of what came, in words.
    """

    station: int
    baud: int
    protocol: LineProtocol
    evidence: tuple[str, ...]
    damaged: int
    asked: int


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes that came and were no module's answer.

    Attributes:
        station: Who had been asked; None: nobody.
        evidence: The bytes, or what was wrong with them.
    """

    station: int | None
    baud: int
    protocol: LineProtocol
    evidence: str


Finding = Found | Clash | Noise


def dip_text(switches: tuple[bool, ...]) -> str:
    """Positions in the groups of the block: station, baud rate, protocol; 1 is ON."""
    bits = "".join(f"{switch:d}" for switch in switches)
    return f"{bits[:5]} {bits[5:7]} {bits[7:]}"
