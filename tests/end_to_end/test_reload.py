"""The configuration is read again while the bridge runs: what is the same feels nothing of it."""

import json
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from support.brokers import RETAIN_SHOWS, Broker
from support.daemon import WAIT_S, Daemon
from support.mqtt_probe import MqttProbe, Seen
from support.panel import broker

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

REQUEST, RESPONSE = "wisco/bridge/request/{}", "wisco/bridge/response/{}"
LINES = ("front", "back")


@dataclass
class House:
    """Two lines with two modules each, a broker, the file, the daemon on it and a probe."""

    lines: dict[str, SimulatedLine]
    config: Path
    probe: MqttProbe
    daemon: Daemon

    def write(self, old: str, new: str) -> None:
        """Changes the file."""
        text = self.config.read_text()
        assert old in text
        self.config.write_text(text.replace(old, new))

    def ask(self, verb: str, arguments: dict[str, Any] | None = None) -> Any:
        """Publishes a request and returns its answer."""
        mark = f"r{len(self.probe.seen)}"
        self.probe.publish(REQUEST.format(verb), json.dumps({**(arguments or {}), "id": mark}))

        def answers(seen: list[Seen]) -> list[Any]:
            told = [json.loads(m.payload) for m in seen if m.topic == RESPONSE.format(verb)]
            return [answer for answer in told if answer.get("id") == mark]

        self.probe.wait_for(lambda seen: bool(answers(seen)))
        [answer] = answers(self.probe.seen)
        return answer

    def input_is_seen(self, line: str, channel: int) -> None:
        """Waits until a change at the line's DIO100 is published."""
        module = self.lines[line].module(1)
        module.toggle_input(channel)
        word = "ON" if module.inputs >> (channel - 1) & 1 else "OFF"
        self.probe.wait_message(f"wisco/{line}_in/di/{channel}", word)

    def since(self, line: str) -> list[Seen]:
        """Return the messages about a line and its stations."""
        marks = (f"/{line}_in/", f"/{line}_out/", f"/line/{line}/")
        return [message for message in self.probe.seen if any(m in message.topic for m in marks)]

    @property
    def orders(self) -> int:
        """Return the number of orders to any output."""
        return sum(
            len(line.module(address).switchings)
            for line in self.lines.values()
            for address in (1, 2)
        )


def section(name: str, line: SimulatedLine) -> str:
    """A line as the file has it."""
    return (
        f"  - id: {name}\n    port: {line.port}\n    baud: 57600\n    protocol: modbus-rtu\n"
        "    stations:\n"
        f"      - {{address: 1, model: DIO100, id: {name}_in}}\n"
        f"      - {{address: 2, model: DO100, id: {name}_out}}\n"
    )


def is_online(seen: list[Seen], *names: str) -> bool:
    """Return whether the newest message about each of these is `online`."""
    latest = {message.topic: message.text for message in seen}
    return all(latest.get(f"wisco/{name}/availability") == "online" for name in names)


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[Broker]:
    """A broker."""
    with broker(tmp_path) as running:
        yield running


@pytest.fixture
def notify(tmp_path: Path) -> Iterator[socket.socket]:
    """The socket on which systemd would listen."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(WAIT_S)
        yield listener


@pytest.fixture
def house(tmp_path: Path, mosquitto: Broker, notify: socket.socket) -> Iterator[House]:
    """All of it, online, and the probe's memory empty."""
    with ExitStack() as stack:
        lines = {
            name: stack.enter_context(
                SimulatedLine(
                    LineProtocol.MODBUS_RTU,
                    57600,
                    [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)],
                )
            )
            for name in LINES
        }
        config = tmp_path / "config.yaml"
        config.write_text(
            f"mqtt: {{host: 127.0.0.1, port: {mosquitto.port}}}\nstate_dir: {tmp_path}\nlines:\n"
            + "".join(section(name, line) for name, line in lines.items())
        )
        probe = stack.enter_context(MqttProbe(mosquitto.port, "wisco/#", "homeassistant/#"))
        daemon = stack.enter_context(Daemon(config, notify=notify))
        names = [f"{name}_{end}" for name in LINES for end in ("in", "out")]
        probe.wait_for(lambda seen: is_online(seen, "bridge/line/front", *names))
        probe.wait_message("wisco/bridge/state", "online")
        assert b"READY=1" in notify.recv(4096)
        probe.clear()
        yield House(lines, config, probe, daemon)
        assert daemon.process.poll() is None
        # Commands and hands went to the DO100s alone: nobody touched the others.
        assert not any(line.module(1).switchings for line in lines.values())
        assert "Traceback" not in daemon.log


def is_cleared(seen: list[Seen], mark: str) -> bool:
    """Return whether the last message on every retained topic of something is empty."""
    stored = [m for m in seen if m.retain or not RETAIN_SHOWS]
    latest = {m.topic: m.payload for m in stored if mark in m.topic}
    return bool(latest) and not any(latest.values())


def test_an_unchanged_line_feels_nothing(house: House, notify: socket.socket) -> None:
    """A name changes on one line: the other one's port, states and availability go on."""
    house.lines["front"].module(2).set_output(3, True)  # by hand: nobody switches it back
    house.probe.wait_message("wisco/front_out/do/3", "ON")
    before = house.orders
    house.probe.clear()
    house.write("id: back_in}", "id: back_in, name: Cellar}")
    house.daemon.signal(signal.SIGHUP)
    for channel in range(1, 17):
        house.input_is_seen("front", channel)
    assert b"RELOADING=1" in notify.recv(4096)
    assert b"READY=1" in notify.recv(4096)
    house.probe.wait_message("homeassistant/device/wisco__back_in/config")
    house.probe.wait_for(lambda seen: is_online(seen, "back_in", "back_out", "bridge/line/back"))
    said = {message.topic for message in house.since("front")}
    assert not [topic for topic in said if topic.endswith(("availability", "problem"))]
    assert not [m for m in house.probe.seen if m.topic == "wisco/bridge/state"]
    back = [m.text for m in house.since("back") if m.topic == "wisco/back_in/availability"]
    assert back == ["offline", "online"]
    assert house.daemon.log.count("connected to the broker") == 1
    assert house.daemon.log.count("line front: ") == 1  # its port was opened once
    assert house.orders == before
    assert house.lines["front"].module(2).outputs == 0b100


def test_a_station_that_goes_is_taken_off_the_air(house: House) -> None:
    """A removed station is offline; then its topics are cleared, also for Home Assistant."""
    house.write("      - {address: 2, model: DO100, id: back_out}\n", "")
    assert house.ask("reload")["data"] == {
        "kept": ["front"],
        "stopped": ["back"],
        "started": ["back"],
    }
    house.probe.wait_message("wisco/back_out/availability", "offline")
    house.probe.wait_for(lambda seen: is_cleared(seen, "back_out"))
    house.probe.wait_for(lambda seen: is_online(seen, "back_in"))
    house.input_is_seen("back", 1)
    assert not [m for m in house.since("front") if m.topic.endswith("availability")]
    info = json.loads(house.probe.wait_message("wisco/bridge/info").payload)
    assert [s["id"] for line in info["lines"] for s in line["stations"]] == [
        "front_in",
        "front_out",
        "back_in",
    ]
    house.probe.publish("wisco/back_out/do/1/set", "ON")
    house.daemon.wait_for_log("unknown station 'back_out'")


def test_a_station_that_changes_its_line(house: House) -> None:
    """A station that changes its line: both lines restart, and the module keeps its state."""
    house.write("id: front_out}", "id: front_lamps}")
    house.write("id: back_out}", "id: front_out}")
    assert house.ask("reload")["data"]["kept"] == []
    house.probe.wait_for(lambda seen: is_online(seen, "front_out", "front_lamps"))
    house.probe.clear()
    house.lines["back"].module(2).set_output(5, True)
    house.probe.wait_message("wisco/front_out/do/5", "ON")


def test_requests_are_answered(house: House) -> None:
    """Requests to the bridge are answered, and wrong ones are refused."""
    assert house.ask("log_level")["data"] == {"level": "info"}
    assert house.ask("log_level", {"level": "debug"})["data"] == {"level": "debug"}
    diagnostics = house.ask("diagnostics")["data"]
    assert set(diagnostics["lines"]) == set(LINES)
    assert set(diagnostics["stations"]) == {f"{n}_{end}" for n in LINES for end in ("in", "out")}
    house.probe.publish("wisco/old/availability", "offline", retain=True)
    assert house.ask("purge")["data"] == {"cleared": ["wisco/old/availability"]}
    house.probe.wait_message("wisco/old/availability", b"")
    answer = house.ask("fly")
    assert (answer["status"], answer["data"]) == ("error", {})
    assert "unknown request" in answer["error"]
