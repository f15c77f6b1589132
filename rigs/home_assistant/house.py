"""The house that Home Assistant is shown: simulated modules, the bridge, a broker of its own."""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from home_assistant.former import FORMER
from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe

from bridge.config.load import load_config
from bridge.config.schema import Config
from bridge.mqtt.announce.discovery import discovery_messages
from bridge.simulator.build import build_line
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from bridge.simulator.pty import PtyEndpoint

BASE = "wisco"
_HEAD = """\
mqtt: {{host: 127.0.0.1, port: {port}, base_topic: {base}}}
homeassistant: {{discovery: {discovery}}}
state_dir: {directory}
lines:
"""
_LOOK_AGAIN_S = 0.005  # a simulated module tells nobody that it was switched
_WAIT_S = 20.0


@dataclass
class House:
    """A bridge with its lines, as long as the block of `house` lasts.

    Attributes:
        directory: Configuration, log and ports.
        broker: What bridge and Home Assistant share.
        lines: The simulated lines, by their ids.
    """

    directory: Path
    broker: Mosquitto
    probe: MqttProbe
    lines: dict[str, SimulatedLine]
    daemon: Daemon
    base: str

    @property
    def config(self) -> Config:
        """Return the configuration of the bridge."""
        return load_config(self.directory / "config.yaml", {})

    def module(self, station_id: str) -> SimulatedModule:
        """The simulated module of a station."""
        for line in self.config.lines:
            for one in line.stations:
                if one.id == station_id:
                    return self.lines[line.id].module(one.address)
        raise LookupError(station_id)

    @property
    def outputs(self) -> dict[tuple[str, int], int]:
        """Return the state of every relay, by line and station."""
        return {
            (name, address): module.outputs
            for name, line in self.lines.items()
            for address, module in line.modules.items()
        }

    @property
    def ordered(self) -> int:
        """Return the number of orders to outputs so far."""
        modules = [module for line in self.lines.values() for module in line.modules.values()]
        return sum(sum(module.ordered.values()) for module in modules)

    def reconfigure(self, text: str, discovery: str) -> None:
        """Has the bridge go by other lines, or announce them in another way.

        Returns when the broker retains the announcements of that, and no others.
        """
        self._write(text, discovery)
        self.probe.publish(f"{self.base}/bridge/request/reload", "{}")
        wanted = {message.topic: message.payload for message in discovery_messages(self.config)}
        wait_until(lambda: self.announcements() == wanted, "the announcements of the change")

    def announcements(self) -> dict[str, bytes]:
        """Return the retained messages for Home Assistant."""
        return retained(self.broker.port, "homeassistant/#")

    def restart_bridge(self) -> None:
        """Stops the bridge, and starts it as it was."""
        self.daemon.stop()
        self.daemon.__enter__()

    def update_bridge(self) -> None:
        """Stops the bridge, and starts the one of this tree in its place."""
        self.daemon.stop()
        self.daemon = Daemon(self.directory / "config.yaml")
        self.daemon.__enter__()

    def _write(self, text: str, discovery: str) -> None:
        path = self.directory / "config.yaml"
        write_config(path, text, self.broker.port, discovery, self.base)


def write_config(path: Path, lines: str, port: int, discovery: str, base: str = BASE) -> None:
    """Writes a configuration; `lines` names ports as `{directory}/...`."""
    values = {"port": port, "base": base, "discovery": discovery, "directory": path.parent}
    path.write_text(_HEAD.format(**values) + lines.replace("{directory}", str(path.parent)))


@contextmanager
def house(
    directory: Path,
    broker: Mosquitto,
    lines: str,
    discovery: str,
    base: str = BASE,
    *,
    former: bool = False,
) -> Iterator[House]:
    """Starts the modules and the bridge, or its `former` release; the broker is there already."""
    directory.mkdir(exist_ok=True)
    path = directory / "config.yaml"
    write_config(path, lines, broker.port, discovery, base)
    with ExitStack() as stack:
        simulated = {
            line.id: stack.enter_context(
                build_line(line, endpoint=PtyEndpoint(Path(line.port), baud=line.baud))
            )
            for line in load_config(path, {}).lines
        }
        probe = stack.enter_context(MqttProbe(broker.port, f"{base}/bridge/state"))
        built = House(directory, broker, probe, simulated, _daemon(path, former=former), base)
        stack.enter_context(built.daemon)
        stack.callback(lambda: built.daemon.__exit__(None, None, None))  # an update exchanged it
        probe.wait_message(f"{base}/bridge/state", "online")
        yield built
        built.daemon.stop()


def _daemon(path: Path, *, former: bool) -> Daemon:
    if not former:
        return Daemon(path)
    # Else it would find the `bridge` of the folder in which it starts.
    environ = {"PYTHONPATH": str(FORMER.source), "PYTHONSAFEPATH": "1"}
    return Daemon(path, python=str(FORMER.python), environ=environ)


def announced(retained: Mapping[str, bytes]) -> dict[str, dict[str, Any]]:
    """Return every component of the retained announcements by its unique id.

    Each has its `platform`, and the `identifiers` of its device.
    """
    found: dict[str, dict[str, Any]] = {}
    for topic, payload in retained.items():
        levels = topic.split("/")
        if levels[0] != "homeassistant" or levels[-1] != "config" or not payload:
            continue
        document = json.loads(payload)
        components = document.get("components", {"": {"platform": levels[1], **document}})
        for component in components.values():
            [identifier] = document["device"]["identifiers"]
            found[component.get("unique_id", topic)] = {**component, "identifier": identifier}
    return found


def retained(port: int, *filters: str) -> dict[str, bytes]:
    """Return the retained messages, read with a new connection."""
    mark = "home-assistant-tests/mark"
    with MqttProbe(port, *filters, mark, qos=0) as probe:
        # What is retained comes before what is published after the subscription.
        probe.publish(mark, str(time.monotonic()))
        probe.wait_message(mark)
        latest = {m.topic: m.payload for m in probe.seen if m.topic != mark}
    return {topic: payload for topic, payload in latest.items() if payload}


def wait_until(condition: Callable[[], bool], what: str, timeout_s: float = _WAIT_S) -> None:
    """Wait for something that sends no event."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"{what}: not within {timeout_s} s"
        time.sleep(_LOOK_AGAIN_S)
