"""The cases: which lines, and what is looked at on them."""

from dataclasses import dataclass, replace

from bench.arithmetic import UNPACED, Limit, Physics
from bench.wire import LineSpec
from bridge.model import DIO100, ModuleType

TURNAROUND_S = 0.002
PROTOCOLS = ("modbus-rtu", "modbus-ascii", "wisco")


@dataclass(frozen=True, slots=True)
class Case:
    """One row of the table.

    Attributes:
        letter: A to F.
        protocol: What all lines speak.
        baud: Of all lines.
        stations: How many DIO100s are on a line; Modbus knows 31 at the most.
        lines: How many equal lines.
        dead: How many of a line's stations say nothing.
        paced: Whether bytes and modules take their time.
        plain_s: How long the plain cycle is watched; so long runs the bare loop too.
        toggle_each_s: How often an input changes, and for how long in all.
        toggle_s: How long inputs change.
        commands: How many commands are sent, one after the other.
        model: Of all stations.
        lost: The share of the replies that is lost.
    """

    letter: str
    protocol: str
    baud: int
    stations: int
    lines: int = 1
    dead: int = 0
    paced: bool = True
    plain_s: float = 8.0
    toggle_each_s: float = 0.1
    toggle_s: float = 40.0
    commands: int = 80
    model: ModuleType = DIO100
    lost: float = 0.0

    @property
    def name(self) -> str:
        """Such as `C modbus-rtu`."""
        pace = "" if self.paced else " unpaced"
        return f"{self.letter} {self.protocol}{pace}"

    @property
    def physics(self) -> Physics:
        """The times of a line."""
        return Physics.of(self.protocol, self.baud, TURNAROUND_S) if self.paced else UNPACED

    @property
    def limit(self) -> Limit:
        """Return the limit that the wire sets."""
        return Limit.of(self.protocol, self.physics)

    @property
    def addresses(self) -> tuple[int, ...]:
        """The stations of a line."""
        return tuple(range(1, self.stations + 1)) if self.stations < 32 else tuple(range(32))

    @property
    def dead_addresses(self) -> frozenset[int]:
        """Return the addresses that do not answer; they are not neighbours."""
        return frozenset(self.addresses[5::10][: self.dead])

    @property
    def live(self) -> tuple[int, ...]:
        """Return the addresses that answer."""
        return tuple(a for a in self.addresses if a not in self.dead_addresses)

    @property
    def spec(self) -> LineSpec:
        """One line of it."""
        return LineSpec(
            *(self.protocol, self.baud, self.physics, self.addresses, self.dead_addresses),
            model=self.model,
            lost=self.lost,
        )

    def config(self, ports: list[str], broker: int, state_dir: str, *, plain: bool) -> str:
        """The bridge's configuration; `plain`: inputs and outputs are read equally."""
        lines = "".join(
            f"  - id: l{index}\n    port: {port}\n    baud: {self.baud}\n"
            f"    protocol: {self.protocol}\n    turnaround: 2ms\n"
            + ("    output_sweep: 0s\n" if plain else "")
            + ("" if self.paced else "    silence: 0s\n")
            + "    stations:\n"
            + "".join(
                f"      - {{address: {a}, model: {self.model.name}, id: l{index}-s{a}}}\n"
                for a in self.addresses
            )
            for index, port in enumerate(ports)
        )
        return (
            f"mqtt: {{host: 127.0.0.1, port: {broker}, base_topic: bench, protocol: 5}}\n"
            f"state_dir: {state_dir}\nlines:\n{lines}"
        )


def _stations(protocol: str) -> int:
    return 32 if protocol == "wisco" else 31


def all_cases() -> list[Case]:
    """Every case, in the order of the table."""
    cases = []
    for protocol in PROTOCOLS:
        many = _stations(protocol)
        cases += [
            Case("A", protocol, 9600, 1, toggle_s=15, commands=40),
            Case("B", protocol, 19200, 8, toggle_s=25, commands=60),
            # The middle of 400 changes at any phase of the round is good to some 5 % only.
            Case("C", protocol, 57600, many, toggle_s=80, commands=120),
            Case("E", protocol, 57600, many, dead=2, toggle_s=80),
        ]
    for protocol in ("modbus-rtu", "wisco"):
        many = _stations(protocol)
        eight = Case("F", protocol, 57600, many, lines=8, toggle_s=20, commands=60)
        alone = Case("D", protocol, 57600, many, paced=False, toggle_each_s=0.002, toggle_s=10)
        cases += [alone, eight, replace(alone, letter="F", lines=8, commands=60)]
    return sorted(cases, key=lambda case: case.letter)
