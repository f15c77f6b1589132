"""`watch`: in a process of its own, against a real broker."""

import json
import re
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe

from bridge.cli.watch import json_line, text_line
from bridge.mqtt.events import Received

NOON = datetime(2024, 5, 1, 12, 0, 0, 7_000, tzinfo=UTC)


@pytest.fixture
def config(tmp_path: Path, mosquitto: Mosquitto) -> Path:
    """A configuration with two stations, at the broker."""
    return write_config(tmp_path, mosquitto.port)


def write_config(directory: Path, port: int) -> Path:
    """Writes a configuration with the stations `garage` and `pumps`."""
    path = directory / "config.yaml"
    path.write_text(
        f"mqtt: {{host: 127.0.0.1, port: {port}}}\n"
        f"state_dir: {directory}\n"
        "lines:\n"
        "  - {id: main, port: /dev/serial/by-id/usb-x, baud: 9600, protocol: wisco,\n"
        "     stations: [{address: 1, model: DIO100, id: garage},\n"
        "                {address: 2, model: DO100, id: pumps}]}\n"
    )
    return path


@contextmanager
def watching(config: Path, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """A running `watch`; killed in the end if it did not end by itself."""
    command = [sys.executable, "-m", "bridge", "watch", "-c", str(config), *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def lines_of(process: "subprocess.Popen[str]", count: int) -> list[str]:
    """Reads its next lines."""
    assert process.stdout is not None
    return [process.stdout.readline().rstrip("\n") for _ in range(count)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_prints_the_first_picture_and_what_happens(
    mosquitto: Mosquitto, config: Path, number: signal.Signals
) -> None:
    """Retained messages are marked, pings and commands are left out, a signal ends it with 0."""
    with MqttProbe(mosquitto.port) as probe:
        probe.publish("wisco/garage/di/3", "OFF", retain=True)
        with watching(config, "--all") as process:
            first = lines_of(process, 1)[0]
            probe.publish("wisco/bridge/ping", "1")
            probe.publish("wisco/garage/do/3/set", "ON")
            probe.publish("wisco/garage/di/3", "ON", retain=True)
            second = lines_of(process, 1)[0]
            process.send_signal(number)
            rest, errors = process.communicate(timeout=20)
            assert (process.returncode, rest, errors) == (0, "", "")
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3} = garage/di/3 OFF", first)
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3} garage/di/3 ON", second)


def test_it_tells_changes_in_words(mosquitto: Mosquitto, config: Path) -> None:
    """A line a change: what was kept, snapshots and diagnostics are no changes."""
    with MqttProbe(mosquitto.port) as probe:
        probe.publish("wisco/garage/di/3", "OFF", retain=True)
        with watching(config, "garage") as process:
            told = _until_told(process, lambda: probe.publish("wisco/garage/di/1", "ON"))
            for topic, payload in (
                ("wisco/garage", '{"di": {}, "do": {}}'),
                ("wisco/garage/diagnostics", "{}"),
                ("wisco/garage/do/2", "OFF"),
            ):
                probe.publish(topic, payload)
            while "input 1" in (last := lines_of(process, 1)[0]):
                pass
    assert re.fullmatch(r"\d\d:\d\d:\d\d garage    input 1 +ON", told)
    assert re.fullmatch(r"\d\d:\d\d:\d\d garage    output 2 +OFF", last)


def _until_told(process: "subprocess.Popen[str]", publish: Callable[[], None]) -> str:
    """Publishes until the watcher, which may not have subscribed yet, tells of it."""
    assert process.stdout is not None
    while not select.select([process.stdout], [], [], 0.1)[0]:
        publish()
    return lines_of(process, 1)[0]


def test_it_needs_no_configuration(mosquitto: Mosquitto, tmp_path: Path) -> None:
    """Flags say where the broker is; a file with a password may be named."""
    command = [sys.executable, "-m", "bridge", "watch", "--host", "127.0.0.1", "--all"]
    command += ["--port", str(mosquitto.port), "--base-topic", "home/wisco"]
    with MqttProbe(mosquitto.port) as probe:
        probe.publish("home/wisco/garage/di/3", "OFF", retain=True)
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path) as process:
            assert lines_of(process, 1)[0].endswith("= garage/di/3 OFF")
            process.terminate()


def test_it_watches_the_named_stations_alone(mosquitto: Mosquitto, config: Path) -> None:
    """Other stations and the bridge itself stay silent; JSON is one object a line."""
    with MqttProbe(mosquitto.port) as probe:
        for topic in ("wisco/garage", "wisco/bridge/state", "wisco/pumps", "wisco/pumps/do/1"):
            probe.publish(topic, "ON", retain=True)
        with watching(config, "pumps", "--json") as process:
            documents = [json.loads(line) for line in lines_of(process, 2)]
            probe.publish("wisco/garage/di/1", "ON")
            probe.publish("wisco/pumps/do/2", "OFF")
            documents += [json.loads(line) for line in lines_of(process, 1)]
    shown = {(one["topic"], one["payload"], one["retained"]) for one in documents}
    assert shown == {
        ("wisco/pumps", "ON", True),
        ("wisco/pumps/do/1", "ON", True),
        ("wisco/pumps/do/2", "OFF", False),
    }
    assert all(datetime.fromisoformat(one["time"]).tzinfo for one in documents)


def test_it_goes_on_after_the_broker_restarts(mosquitto: Mosquitto, config: Path) -> None:
    """The loss and the return are told on stderr; stdout holds data alone."""
    with watching(config, "--all") as process:
        with MqttProbe(mosquitto.port) as probe:
            probe.publish("wisco/garage/di/1", "OFF", retain=True)
            lines_of(process, 1)
        mosquitto.restart()
        with MqttProbe(mosquitto.port) as probe:
            probe.publish("wisco/garage/di/1", "ON", retain=True)
            assert lines_of(process, 1)[0].endswith("garage/di/1 ON")
        process.send_signal(signal.SIGTERM)
        assert "lost the broker" in process.communicate(timeout=20)[1]
        assert process.returncode == 0


def test_no_payload_breaks_a_line_or_steers_a_terminal() -> None:
    """Control characters are shown as what they are; other languages stay as they are."""
    message = Received("b/a", "ประตู\n\x1b[2J".encode() + b"\xff", retain=False, at=0.0)
    assert text_line(message, "b", NOON) == "12:00:00.007 a ประตู\\x0a\\x1b[2J\ufffd"


def test_a_json_line_is_whole() -> None:
    """Time with zone, full topic, payload as text, and whether the broker had kept it."""
    message = Received("b/a", "ประตู".encode(), retain=True, at=0.0)
    assert json_line(message, NOON) == (
        '{"time": "2024-05-01T12:00:00.007+00:00", "topic": "b/a", "payload": "ประตู", '
        '"retained": true}'
    )
