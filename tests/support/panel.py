"""A panel on a simulated line: the configuration that goes with it, and what it must publish."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.brokers import WILDCARDS_SHOW_RETAINED, Broker, new_broker
from support.mqtt_probe import Seen

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Listener, SimulatedModule

BASE = "wisco"
# One DIO100 at station 1, one DO100 at station 2.
STATIONS = {"garage": (1, DIO100), "pumps": (2, DO100)}


@contextmanager
def panel(
    protocol: LineProtocol, listener: Listener | None = None, *, paced: bool = True
) -> Iterator[SimulatedLine]:
    """A line with one module of each model, at 9600 baud and at the pace of the wire."""
    modules = [
        SimulatedModule(model, station=address, listener=listener)
        for address, model in STATIONS.values()
    ]
    with SimulatedLine(protocol, 9600, modules, paced=paced) as line:
        yield line


def write_config(
    directory: Path, line: SimulatedLine, broker_port: int, *, discovery: str = "device"
) -> Path:
    """Writes the configuration for `panel` and gives its path."""
    stations = "".join(
        f"      - {{address: {address}, model: {model.name}, id: {name}}}\n"
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


def retained_topics() -> set[str]:
    """Every retained topic below the base topic while all of `panel` is online."""
    topics = {
        f"{BASE}/bridge/state",
        f"{BASE}/bridge/info",
        f"{BASE}/bridge/line/main/availability",
    }
    for name, (_, model) in STATIONS.items():
        station = f"{BASE}/{name}"
        topics |= {station, f"{station}/availability", f"{station}/problem"}
        topics |= {f"{station}/di/{n}" for n in range(1, model.inputs + 1)}
        for n in range(1, model.outputs + 1):
            output = f"{station}/do/{n}"
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
