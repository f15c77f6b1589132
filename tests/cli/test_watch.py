"""`watch`: in a process of its own, against a real broker."""

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest
from support.mosquitto import Mosquitto, free_port
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
        with watching(config) as process:
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
    with watching(config) as process:
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


def test_an_absent_broker_is_one_line_and_status_1(tmp_path: Path) -> None:
    """A missing broker gives one line with its address and the cause, and status 1."""
    config = write_config(tmp_path, free_port())
    with watching(config, "--timeout", "0.5") as process:
        output, errors = process.communicate(timeout=20)
    assert (process.returncode, output) == (1, "")
    assert errors.count("\n") == 1
    assert errors.startswith("wisco2mqtt: no connection to the broker at 127.0.0.1:")


def test_an_unknown_station_is_wrong_usage(tmp_path: Path) -> None:
    """The line lists the stations that there are."""
    with watching(write_config(tmp_path, 1883), "cellar") as process:
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 2
    assert "there is no station cellar; there are: garage, pumps" in errors


def test_no_payload_breaks_a_line_or_steers_a_terminal() -> None:
    """Control characters are shown as what they are; other languages stay as they are."""
    message = Received("b/a", "ประตู\n\x1b[2J".encode() + b"\xff", retain=False, at=0.0)
    assert text_line(message, "b", NOON) == "12:00:00.007 a ประตู\\x0a\\x1b[2J\ufffd"


def test_a_json_line_is_whole() -> None:
    """Time with zone, full topic, payload as text, and whether the broker had kept it."""
    message = Received("b/a", "ประตู".encode(), retain=True, at=0.0)
    assert json_line(message, "b", NOON) == (
        '{"time": "2024-05-01T12:00:00.007+00:00", "topic": "b/a", "payload": "ประตู", '
        '"retained": true}'
    )
