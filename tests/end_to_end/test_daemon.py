"""The start and the stop of the daemon, as systemd sees them."""

import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.brokers import Broker
from support.daemon import WAIT_S, Daemon
from support.mosquitto import free_port
from support.mqtt_probe import MqttProbe, held_at
from support.panel import BASE, broker, is_complete, panel, panel_filters, write_config

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine

STOPPED_WITHIN_S = 2.0


@pytest.fixture
def line() -> Iterator[SimulatedLine]:
    """A line with one module of each model."""
    with panel(LineProtocol.MODBUS_RTU) as simulated:
        yield simulated


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


def test_ready_is_said_when_the_lines_work_even_without_a_broker(
    line: SimulatedLine, notify: socket.socket, tmp_path: Path
) -> None:
    """An absent broker holds nothing up: READY comes, and STOPPING at the end."""
    with Daemon(write_config(tmp_path, line, free_port()), notify=notify) as daemon:
        assert b"READY=1" in notify.recv(4096)
        daemon.wait_for_log("online: DIO100")
        assert daemon.stop()[0] == 0
        assert b"STOPPING=1" in notify.recv(4096)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_0_within_2_s_and_offline_published(
    line: SimulatedLine, mosquitto: Broker, tmp_path: Path, number: signal.Signals
) -> None:
    """Stations, line and bridge are retained as offline before it goes."""
    config = write_config(tmp_path, line, mosquitto.port)
    with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config) as daemon:
        probe.wait_for(is_complete)
        probe.clear()
        daemon.signal(number)
        assert daemon.process.wait(STOPPED_WITHIN_S) == 0
        probe.wait_message(f"{BASE}/bridge/state", "offline")
        said = held_at(mosquitto.port, *panel_filters())
    for name in ("garage/availability", "pumps/availability", "bridge/line/main/availability"):
        assert said[f"{BASE}/{name}"] == "offline"


def test_a_last_will_says_offline_when_it_is_killed(
    line: SimulatedLine, mosquitto: Broker, tmp_path: Path
) -> None:
    """After kill -9 the broker publishes `offline` by the last will."""
    config = write_config(tmp_path, line, mosquitto.port)
    with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config) as daemon:
        probe.wait_for(is_complete)
        daemon.signal(signal.SIGKILL)
        probe.wait_message(f"{BASE}/bridge/state", "offline")
        state = f"{BASE}/bridge/state"
        assert held_at(mosquitto.port, state) == {state: "offline"}


def test_sighup_takes_a_changed_configuration_and_leaves_a_broken_one(
    line: SimulatedLine, mosquitto: Broker, tmp_path: Path
) -> None:
    """A problem is named and changes nothing; a valid change is there without a new process."""
    config = write_config(tmp_path, line, mosquitto.port)
    good = config.read_text()
    with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config) as daemon:
        probe.wait_for(is_complete)
        config.write_text(good.replace("DO100", "DO101"))
        daemon.signal(signal.SIGHUP)
        daemon.wait_for_log("DO101")
        daemon.wait_for_log("runs on as it was")
        config.write_text(good.replace("id: pumps", "id: wells"))
        daemon.signal(signal.SIGHUP)
        probe.wait_message(f"{BASE}/wells/availability", "online")
        assert daemon.stop()[0] == 0


def test_a_wrong_configuration_ends_it_with_78_and_no_traceback(tmp_path: Path) -> None:
    """Systemd does not start it again (RestartPreventExitStatus=78)."""
    config = tmp_path / "config.yaml"
    config.write_text("lines: []\nmqttt: {}\n")
    with Daemon(config) as daemon:
        assert daemon.process.wait(WAIT_S) == 78
        assert f"{config}:2:1: " in daemon.log
        assert "Traceback" not in daemon.log


def test_a_missing_configuration_ends_it_with_78(tmp_path: Path) -> None:
    """One line says which file was looked for."""
    with Daemon(tmp_path / "nowhere.yaml") as daemon:
        assert daemon.process.wait(WAIT_S) == 78
        assert "nowhere.yaml" in daemon.log
        assert len(daemon.log.splitlines()) == 1
