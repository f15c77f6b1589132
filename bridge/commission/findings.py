"""What a scan found, as frozen values."""

from dataclasses import dataclass

from bridge.commission.dip import switches_for
from bridge.model import LineProtocol, ModuleType, OutputSettings

# Switch 8 ON (docs/protocol.md section 1).
TEXT_PROTOCOLS = (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
_MOST_NOISES = 100


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
        """Return what a line with this module is configured as."""
        return self.protocols[0]

    @property
    def switches(self) -> tuple[bool, ...]:
        """Return where its DIP switches stand, as far as answers tell."""
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
        station: Who had been asked; None: no module.
        evidence: The bytes, or what was wrong with them.
    """

    station: int | None
    baud: int
    protocol: LineProtocol
    evidence: str


Finding = Found | Clash | Noise


class Findings:
    """All that one scan found.

    Attributes:
        found: The modules, in the order in which they answered.
        clashes: The addresses where more than one module answers.
        noises: What came and was no answer; of very many, the first.
    """

    def __init__(self) -> None:
        self.found: list[Found] = []
        self.clashes: list[Clash] = []
        self.noises: list[Noise] = []

    def add(self, finding: Finding) -> bool:
        """Take one; False: it is noise, and there was enough of that already."""
        match finding:
            case Found():
                self.found = [one for one in self.found if not _is_same(one, finding)]
                self.found.append(finding)
            case Clash():
                self.clashes.append(finding)
            case Noise():
                if len(self.noises) == _MOST_NOISES:
                    return False
                self.noises.append(finding)
        return True

    def is_known(self, station: int, baud: int, protocol: LineProtocol) -> bool:
        """Return whether an address need not be asked any more."""
        known: list[Found | Clash] = [*self.found, *self.clashes]
        return any(
            one.station == station and one.baud == baud and protocol in _answers(one)
            for one in known
        )


def _answers(one: Found | Clash) -> tuple[LineProtocol, ...]:
    """Return what need not be asked any more; two voices are two voices in either text protocol."""
    if isinstance(one, Found):
        return one.protocols
    return (one.protocol,) if one.protocol is LineProtocol.MODBUS_RTU else TEXT_PROTOCOLS


def _is_same(one: Found, other: Found) -> bool:
    """Return whether it is the module that was found before, in the other of its two protocols."""
    return (one.station, one.switches) == (other.station, other.switches)


def dip_text(switches: tuple[bool, ...]) -> str:
    """Positions in the groups of the block: station, baud rate, protocol; 1 is ON."""
    bits = "".join(f"{switch:d}" for switch in switches)
    return f"{bits[:5]} {bits[5:7]} {bits[7:]}"
