"""The house of the soak: a line of each protocol, live and dead modules of both models."""

import random
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from bridge.model import DIO100, DO100, LineProtocol, ModuleType
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Listener, SimulatedModule, Switching
from bridge.simulator.pty import PtyEndpoint
from bridge.simulator.tcp import TcpEndpoint

BASE = "soak"
BAUD = 57600
# Bytes take no time, modules do: a hundred exchanges a second on each line are plenty, and leave
# the computer to others.
TURNAROUND_S = 0.008
PULSE, READ_ONLY, FUZZED = 2, 3, 8  # outputs with a part of their own, of every module
HOLD_S = 0.3


@dataclass(frozen=True, slots=True)
class Home:
    """One module of the house."""

    id: str
    line: str
    address: int
    model: ModuleType
    dead: bool = False  # from the first minute to the last: a steady fault


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
    """The simulated lines, and every switching of every relay since it was last looked at."""

    lines: dict[str, SimulatedLine]
    switchings: deque[tuple[str, Switching]] = field(default_factory=deque)

    def module(self, home: Home) -> SimulatedModule:
        """The module of a home."""
        return self.lines[home.line].module(home.address)

    def listener(self, line: str) -> Listener:
        """Takes down what is switched on one line: appending to a deque is atomic."""
        names = {home.address: home.id for home in HOMES if home.line == line}
        return lambda address, switching: self.switchings.append((names[address], switching))


@contextmanager
def house(chance: random.Random) -> Iterator[House]:
    """The house; its line `asc` is reached over TCP, the others over pseudo-terminals."""
    built = House({})
    with ExitStack() as stack:
        for name, protocol in LINES.items():
            line = _line(name, protocol, built.listener(name), chance)
            built.lines[name] = stack.enter_context(line)
        yield built


def write_config(path: Path, built: House, broker_port: int) -> None:
    """Writes the configuration of the house."""
    lines = "".join(
        f"  - id: {name}\n    port: {line.port}\n    baud: {BAUD}\n"
        f"    protocol: {line.protocol}\n    stations:\n{_stations(name)}"
        for name, line in built.lines.items()
    )
    path.write_text(
        f"mqtt: {{host: 127.0.0.1, port: {broker_port}, base_topic: {BASE}, protocol: 5}}\n"
        f"state_dir: {path.parent}\nlines:\n{lines}"
    )


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


def _stations(line: str) -> str:
    return "".join(
        f"      - address: {home.address}\n        model: {home.model.name}\n"
        f"        id: {home.id}\n        outputs:\n"
        f"          {PULSE}: {{mode: pulse, hold: {HOLD_S}s}}\n"
        f"          {READ_ONLY}: {{read_only: true}}\n"
        for home in HOMES
        if home.line == line
    )
