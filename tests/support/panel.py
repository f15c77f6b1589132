"""A panel on a simulated line: the configuration that goes with it, and what it must publish."""

import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from support.brokers import WILDCARDS_SHOW_RETAINED, Broker, new_broker
from support.daemon import WAIT_S, Daemon
from support.mqtt_probe import MqttProbe, Seen

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Listener, SimulatedModule, Switching

BASE = "wisco"
# One DIO100 at station 1, one DO100 at station 2.
STATIONS = {"garage": (1, DIO100), "pumps": (2, DO100)}


@contextmanager
def panel(
    protocol: LineProtocol, listener: Listener | None = None, *, paced: bool = True
) -> Iterator[SimulatedLine]:
    """A line with one module of each model, at 9600 baud and at the pace of the wire."""
    modules = [
        SimulatedModule(model, address=address, listener=listener)
        for address, model in STATIONS.values()
    ]
    with SimulatedLine(protocol, 9600, modules, paced=paced) as line:
        yield line


def write_config(
    directory: Path,
    line: SimulatedLine,
    broker_port: int,
    *,
    discovery: str = "device",
    **keys: str,
) -> Path:
    """Write the configuration for `panel`; `keys` has further keys of a station by its id."""
    stations = "".join(
        f"      - {{address: {address}, model: {model.name}, {_with(keys.get(name))}id: {name}}}\n"
        for name, (address, model) in STATIONS.items()
    )
    path = directory / "config.yaml"
    path.write_text(
        f"mqtt: {{host: 127.0.0.1, port: {broker_port}}}\n"
        f"homeassistant: {{discovery: {discovery}}}\n"
        f"state_dir: {directory}\n"
        "lines:\n"
        f"  - id: main\n    port: {line.port}\n    baud: 9600\n"
        f"    protocol: {line.protocol}\n    stations:\n{stations}"
    )
    return path


def _with(keys: str | None) -> str:
    return f"{keys}, " if keys else ""


def retained_topics() -> set[str]:
    """Every retained topic below the base topic while all of `panel` is online."""
    topics = {
        f"{BASE}/bridge/state",
        f"{BASE}/bridge/info",
        f"{BASE}/bridge/line/main/availability",
    }
    for name, (_, model) in STATIONS.items():
        topic = f"{BASE}/{name}"
        topics |= {topic, f"{topic}/availability", f"{topic}/problem"}
        topics |= {f"{topic}/di/{n}" for n in range(1, model.inputs + 1)}
        for n in range(1, model.outputs + 1):
            output = f"{topic}/do/{n}"
            topics |= {output, f"{output}/mode", f"{output}/hold"}
    return topics


def panel_filters() -> set[str]:
    """Filters for all of `panel`; by name too, where wildcards show nothing that is retained."""
    return {f"{BASE}/#"} if WILDCARDS_SHOW_RETAINED else {f"{BASE}/#", *retained_topics()}


def is_complete(seen: list[Seen]) -> bool:
    """Return whether everything retained was published, and everything is online."""
    latest = {message.topic: message.text for message in seen}
    availability = [topic for topic in retained_topics() if topic.endswith("availability")]
    online = [f"{BASE}/bridge/state", *availability]
    return retained_topics() <= set(latest) and all(latest[t] == "online" for t in online)


def results(seen: list[Seen]) -> list[dict[str, object]]:
    """The verdicts among what was seen, oldest first."""
    return [json.loads(m.payload) for m in seen if m.topic.endswith("/result")]


@contextmanager
def broker(directory: Path) -> Iterator[Broker]:
    """A broker that runs until the end of the block."""
    running = new_broker(directory / "broker")
    try:
        running.start()
        yield running
    finally:
        running.stop()


@dataclass
class House:
    """The panel, its broker, the daemon, and a probe on everything below the base topic."""

    line: SimulatedLine
    mosquitto: Broker
    config: Path
    probe: MqttProbe
    daemon: Daemon
    ids: "count[int]" = field(default_factory=count)

    def command(self, topic: str, wish: dict[str, Any]) -> dict[str, Any]:
        """Publish a command with an id of its own, and return its verdict."""
        identity = f"c{next(self.ids)}"
        self.probe.publish(f"{BASE}/{topic}", json.dumps({**wish, "id": identity}))
        return self.verdict(identity)

    def verdict(self, identity: str) -> dict[str, Any]:
        """Wait for the verdict on the command with this id, and return it."""
        seen = self.probe.wait_for(lambda seen: any(v.get("id") == identity for v in results(seen)))
        (verdict,) = (v for v in results(seen) if v.get("id") == identity)
        return verdict

    def orders(self) -> list[Switching]:
        """Return what frames ordered of station 1; a hand at the module is no order."""
        return [switching for switching in self.line.module(1).switchings if switching.frame]

    def wait(self, condition: Callable[[], bool]) -> None:
        """Wait until something holds of which no message tells: it is looked at again."""
        deadline = time.monotonic() + WAIT_S
        while not condition():
            assert time.monotonic() < deadline, f"orders: {self.orders()}\n{self.daemon.log}"
            time.sleep(0.01)

    def reload(self, old: str, new: str) -> None:
        """Change the file, and tell the daemon by a signal."""
        text = self.config.read_text()
        assert old in text
        self.config.write_text(text.replace(old, new))
        self.daemon.signal(signal.SIGHUP)


@contextmanager
def house(directory: Path, protocol: LineProtocol, **keys: str) -> Iterator[House]:
    """All of it, online, until the end of the block; `keys` as for `write_config`."""
    with panel(protocol) as line, broker(directory) as mosquitto:
        config = write_config(directory, line, mosquitto.port, **keys)
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config) as daemon:
            probe.wait_for(is_complete)
            yield House(line, mosquitto, config, probe, daemon)
