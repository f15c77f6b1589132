"""The findings of a scan, as frozen values."""

from dataclasses import dataclass

from bridge.commission.dip import switches_for
from bridge.model import LineProtocol, ModuleType, OutputSettings

# Switch 8 ON (docs/protocol.md section 1).
TEXT_PROTOCOLS = (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
_MOST_NOISES = 100


@dataclass(frozen=True, slots=True)
class Found:
    """A module that answered reliably.

    Attributes:
        protocols: The protocols that it answers; a line is configured with the first one.
        settings: Its modes and hold times; None: it takes no Modbus frames, or did not answer.
        damaged: The number of damaged replies.
        asked: The number of requests.
    """

    address: int
    model: ModuleType
    baud: int
    protocols: tuple[LineProtocol, ...]
    settings: OutputSettings | None
    damaged: int
    asked: int

    @property
    def protocol(self) -> LineProtocol:
        """Return the protocol for the line of this module."""
        return self.protocols[0]

    @property
    def switches(self) -> tuple[bool, ...]:
        """Return the positions of its DIP switches, as far as they are known from the answers."""
        return switches_for(self.address, self.baud, self.protocol)


@dataclass(frozen=True, slots=True)
class Clash:
    """An address with answers that make no sense: usually two modules.

    Attributes:
        evidence: Some of the answers, in words.
    """

    address: int
    baud: int
    protocol: LineProtocol
    evidence: tuple[str, ...]
    damaged: int
    asked: int


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes that are not the answer of a module.

    Attributes:
        address: The address that had been asked; None: none.
        evidence: The bytes, or what was wrong with them.
    """

    address: int | None
    baud: int
    protocol: LineProtocol
    evidence: str


Finding = Found | Clash | Noise


class Findings:
    """All findings of one scan.

    Attributes:
        found: The modules, in the order in which they answered.
        clashes: The addresses where more than one module answers.
        noises: Bytes that were no answer; the first ones if there are many.
    """

    def __init__(self) -> None:
        self.found: list[Found] = []
        self.clashes: list[Clash] = []
        self.noises: list[Noise] = []

    def add(self, finding: Finding) -> bool:
        """Add a finding; return False if it is noise beyond the limit."""
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

    def is_known(self, address: int, baud: int, protocol: LineProtocol) -> bool:
        """Return whether an address need not be asked again."""
        known: list[Found | Clash] = [*self.found, *self.clashes]
        return any(
            one.address == address and one.baud == baud and protocol in _answers(one)
            for one in known
        )


def _answers(one: Found | Clash) -> tuple[LineProtocol, ...]:
    """Return the protocols that need not be asked again; a clash holds for both text protocols."""
    if isinstance(one, Found):
        return one.protocols
    return (one.protocol,) if one.protocol is LineProtocol.MODBUS_RTU else TEXT_PROTOCOLS


def _is_same(one: Found, other: Found) -> bool:
    """Return whether both are one module, found in both of its protocols."""
    return (one.address, one.switches) == (other.address, other.switches)


def dip_text(switches: tuple[bool, ...]) -> str:
    """Return the positions in groups: station, baud rate, protocol; 1 is ON."""
    bits = "".join(f"{switch:d}" for switch in switches)
    return f"{bits[:5]} {bits[5:7]} {bits[7:]}"
