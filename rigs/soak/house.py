"""The house of the soak: a line of each protocol, live and dead modules of both models.

Outputs of every module have a part of their own, those that a DO100 alone has too.
"""

import random
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

from bridge.model import DIO100, DO100, LineProtocol, ModuleType, bit
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Listener, SimulatedModule, Switching
from bridge.simulator.pty import PtyEndpoint
from bridge.simulator.tcp import TcpEndpoint
from soak.relays import Move, Rules

BASE = "soak"
BAUD = 57600
# Bytes take no time, modules do: a hundred exchanges a second on each line are plenty, and leave
# the computer to others.
TURNAROUND_S = 0.008
LONGEST_HOLD_S = 1.0  # of those that a tool sets
PULSE, READ_ONLY, MAX_ON, ON_LOSS, FUZZED = 2, 3, 4, 5, 8
HOLD_S = 0.3
INTERLOCKED = (6, 7)
COVERS = {"shutter": (9, 10), "awning": (11, 12)}  # of each DO100: the outputs open and close
DEAD_TIME_S = 0.4
WAY_S = 2.0
MAX_ON_S = 5.0
AFTER_S = 3.0  # a broker is away that long sometimes, and often for less
RULES = Rules(
    pulses=frozenset({PULSE}),
    longest_hold_s=LONGEST_HOLD_S,
    read_only=READ_ONLY,
    motors=frozenset(output for pair in COVERS.values() for output in pair),
    way_s=WAY_S + 0.5,  # so long the motor runs on at an end
    max_on=MAX_ON,
    max_on_s=MAX_ON_S,
    on_loss=ON_LOSS,
    after_s=AFTER_S,
    groups=(INTERLOCKED, *COVERS.values()),
    dead_time_s=DEAD_TIME_S,
)


@dataclass(frozen=True, slots=True)
class Home:
    """One module of the house."""

    id: str
    line: str
    address: int
    model: ModuleType
    dead: bool = False  # from the first minute to the last: a steady fault

    @property
    def latches(self) -> tuple[int, ...]:
        """The outputs without a part of their own."""
        return (1, *range(13, self.model.outputs + 1))

    @property
    def has_covers(self) -> bool:
        """Return whether it drives motors."""
        return self.model is DO100


LINES = {
    "wis": LineProtocol.WISCO,
    "rtu": LineProtocol.MODBUS_RTU,
    "asc": LineProtocol.MODBUS_ASCII,
}
HOMES = (
    Home("wis-in", "wis", 1, DIO100),
    Home("wis-out", "wis", 2, DO100),
    Home("wis-dead", "wis", 3, DIO100, dead=True),
    Home("rtu-in", "rtu", 1, DIO100),
    Home("rtu-out", "rtu", 2, DO100),
    Home("rtu-dead", "rtu", 7, DO100, dead=True),
    Home("asc-in", "asc", 4, DIO100),
    Home("asc-out", "asc", 31, DO100),
    Home("asc-dead", "asc", 9, DIO100, dead=True),
)
LIVE = tuple(home for home in HOMES if not home.dead)
DEAD = tuple(home for home in HOMES if home.dead)


@dataclass(frozen=True, slots=True)
class House:
    """The simulated lines, and every move of every relay since it was last looked at."""

    lines: dict[str, SimulatedLine]
    moves: deque[Move] = field(default_factory=deque)

    def module(self, home: Home) -> SimulatedModule:
        """The module of a home."""
        return self.lines[home.line].module(home.address)

    def listener(self, line: str) -> Listener:
        """Takes down what is switched on one line: appending to a deque is atomic."""
        names = {home.address: home.id for home in HOMES if home.line == line}

        def listen(address: int, switching: Switching) -> None:
            module = self.lines[line].module(address)
            pulse = bit(switching.output) & module.settings.pulse
            self.moves.append(Move(names[address], switching, pulse=pulse != 0))

        return listen


@contextmanager
def house(chance: random.Random) -> Iterator[House]:
    """The house; its line `asc` is reached over TCP, the others over pseudo-terminals."""
    built = House({})
    with ExitStack() as stack:
        for name, protocol in LINES.items():
            line = _line(name, protocol, built.listener(name), chance)
            built.lines[name] = stack.enter_context(line)
        yield built


def _line(
    name: str, protocol: LineProtocol, listener: Listener, chance: random.Random
) -> SimulatedLine:
    modules = [_module(home, listener) for home in HOMES if home.line == name]
    return SimulatedLine(
        protocol,
        BAUD,
        modules,
        paced=False,
        turnaround_s=TURNAROUND_S,
        endpoint=TcpEndpoint() if name == "asc" else PtyEndpoint(baud=BAUD),
        chance=random.Random(chance.random()),  # noqa: S311  # no secret
        name=name,
    )


def _module(home: Home, listener: Listener) -> SimulatedModule:
    module = SimulatedModule(home.model, home.address, listener=listener)
    module.set_mode(PULSE, pulse=True, hold_s=HOLD_S)
    module.away = home.dead
    return module


def stations_on(line: str) -> list[str]:
    """The ids of the modules of one line."""
    return [home.id for home in HOMES if home.line == line]
