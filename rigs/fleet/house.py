"""A small house behind a cluster: two lines over TCP, four modules."""

import json
import random
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

from soak.relays import Move, Rules

from bridge.model import DIO100, DO100, LineProtocol, ModuleType, bit
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Listener, SimulatedModule, Switching
from bridge.simulator.tcp import TcpEndpoint

BASE = "north/cellar"
BAUD = 57600
PULSE, LATCHES, HOLD_S = 2, (1, 3), 0.3
RULES = Rules(pulses=frozenset({PULSE}))
LINES = {"wis": LineProtocol.WISCO, "rtu": LineProtocol.MODBUS_RTU}
STATIONS: dict[str, tuple[str, int, ModuleType]] = {
    "door": ("wis", 1, DIO100),
    "pumps": ("wis", 2, DO100),
    "gate": ("rtu", 1, DIO100),
    "lamps": ("rtu", 2, DO100),
}


@dataclass
class House:
    """The lines, and every move of a relay since it was last looked at."""

    lines: dict[str, SimulatedLine] = field(default_factory=dict)
    moves: deque[Move] = field(default_factory=deque)

    def module(self, station_id: str) -> SimulatedModule:
        """Return the module of a station."""
        line, address, _ = STATIONS[station_id]
        return self.lines[line].module(address)

    def touch(self, chance: random.Random) -> None:
        """Change an input of each line: what was published is untrue from now on."""
        for station_id in ("door", "gate"):
            self.module(station_id).toggle_input(chance.randint(1, DIO100.inputs))

    def untrue(self, told: Mapping[str, bytes]) -> str | None:
        """Return the first topic that is not as the modules are, in words; None: all are true."""
        for topic, payload in self._truth().items():
            if told.get(topic) != payload:
                return f"{topic} is {told.get(topic)!r}, not {payload!r}"
        for station_id in STATIONS:
            picture = told.get(f"{BASE}/{station_id}", b"{}")
            if json.loads(picture) != self._picture(station_id):
                return f"{BASE}/{station_id} is {picture!r}"
        return None

    def topics(self) -> list[str]:
        """Return what has to be true, by name: a broker may show nothing for a wildcard."""
        return [*self._truth(), *(f"{BASE}/{station_id}" for station_id in STATIONS)]

    def configuration(self, mqtt: str, state_dir: str) -> str:
        """Return the bridge's configuration; `mqtt` has the keys of that section."""
        lines = "".join(
            f"  - id: {name}\n    port: {line.port}\n    baud: {BAUD}\n"
            f"    protocol: {line.protocol}\n    stations:\n{_stations(name)}"
            for name, line in self.lines.items()
        )
        return f"mqtt: {{base_topic: {BASE}, {mqtt}}}\nstate_dir: {state_dir}\nlines:\n{lines}"

    def _truth(self) -> dict[str, bytes]:
        online = [f"{BASE}/bridge/state"]
        online += [f"{BASE}/bridge/line/{line}/availability" for line in LINES]
        online += [f"{BASE}/{station_id}/availability" for station_id in STATIONS]
        values = {
            f"{BASE}/{station_id}/{bank}/{channel}": word.encode()
            for station_id in STATIONS
            for bank, words in self._picture(station_id).items()
            for channel, word in words.items()
        }
        return dict.fromkeys(online, b"online") | values

    def _picture(self, station_id: str) -> dict[str, dict[str, str]]:
        module = self.module(station_id)
        banks = {
            "di": (module.model.inputs, module.inputs),
            "do": (module.model.outputs, module.outputs),
        }
        return {
            bank: {str(n + 1): "ON" if bits >> n & 1 else "OFF" for n in range(count)}
            for bank, (count, bits) in banks.items()
        }


@contextmanager
def house() -> Iterator[House]:
    """The house while its lines run."""
    built = House()
    with ExitStack() as stack:
        for name, protocol in LINES.items():
            line = SimulatedLine(
                protocol,
                BAUD,
                _modules(name, _listener(built, name)),
                paced=False,  # the computer is left to the brokers
                turnaround_s=0.008,
                endpoint=TcpEndpoint(),
                name=name,
            )
            built.lines[name] = stack.enter_context(line)
        yield built


def _modules(line: str, listener: Listener) -> Iterator[SimulatedModule]:
    for on_line, address, model in STATIONS.values():
        if on_line == line:
            module = SimulatedModule(model, address, listener=listener)
            module.set_mode(PULSE, pulse=True, hold_s=HOLD_S)
            yield module


def _listener(built: House, line: str) -> Listener:
    names = {address: name for name, (on, address, _) in STATIONS.items() if on == line}

    def listen(address: int, switching: Switching) -> None:
        module = built.lines[line].module(address)
        pulse = bit(switching.output) & module.settings.pulse != 0
        built.moves.append(Move(names[address], switching, pulse))

    return listen


def _stations(line: str) -> str:
    return "".join(
        f"      - {{address: {address}, model: {model.name}, id: {name}, "
        f"outputs: {{{PULSE}: {{mode: pulse, hold: {HOLD_S}s}}}}}}\n"
        for name, (on_line, address, model) in STATIONS.items()
        if on_line == line
    )
