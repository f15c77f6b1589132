"""SIGTERM and SIGHUP while motors run and modules are dead: the real daemon, on simulated lines."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.daemon import WAIT_S, Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, broker, is_complete, panel, write_config

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine

LIVE, DEAD = 1, 2
LIVE_COVERS, DEAD_COVERS = 4, 8
WITHIN_S = 3.0
OPENING = 0b0101_0101_0101_0101


@dataclass
class House:
    """A daemon at a DIO100 with four covers and a DO100 with eight, all of which move."""

    line: SimulatedLine
    daemon: Daemon
    config: Path

    def outputs(self, address: int) -> int:
        """Return the relays of a module."""
        return self.line.module(address).outputs

    def wait_off(self, address: int, since: float) -> None:
        """Waits until the motors of a module stand, which is to be in time."""
        while self.outputs(address):
            assert time.monotonic() < since + WITHIN_S, self.daemon.log
            time.sleep(0.01)

    def named(self) -> int:
        """Return how many covers of the dead module the log names."""
        lines = self.daemon.log.splitlines()
        return sum("(pumps): cover" in line and "may still move" in line for line in lines)


def _covers(count: int) -> str:
    covers = (
        f"c{n}: {{name: C{n}, open: {2 * n - 1}, close: {2 * n}, "
        "open_time: 120s, close_time: 120s}"
        for n in range(1, count + 1)
    )
    return f"covers: {{{', '.join(covers)}}}"


@contextmanager
def _house(directory: Path, protocol: LineProtocol, timeout: str = "auto") -> Iterator[House]:
    with panel(protocol) as line, broker(directory) as mosquitto:
        config = write_config(directory, line, mosquitto.port)
        text = config.read_text().replace("baud: 9600\n", f"baud: 9600\n    timeout: {timeout}\n")
        for name, count in (("garage", LIVE_COVERS), ("pumps", DEAD_COVERS)):
            text = text.replace(f"id: {name}}}", f"id: {name}, {_covers(count)}}}")
        config.write_text(text)
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config) as daemon:
            probe.wait_for(is_complete)
            for address, outputs in ((LIVE, 0xFF), (DEAD, 0xFFFF)):
                line.module(address).write_outputs(outputs, OPENING & outputs, b"")
            for station, count in (("garage", LIVE_COVERS), ("pumps", DEAD_COVERS)):
                for n in range(1, count + 1):
                    probe.wait_message(f"{BASE}/{station}/cover/c{n}/state", "opening")
            line.module(DEAD).away = True
            yield House(line, daemon, config)


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_a_stop_stops_the_live_motors_names_the_others_and_ends_with_1(
    tmp_path: Path, protocol: LineProtocol
) -> None:
    """A module with eight moving covers died just now, and each try takes a second."""
    with _house(tmp_path, protocol, timeout="1s") as house:
        house.daemon.signal(signal.SIGTERM)
        house.wait_off(LIVE, time.monotonic())
        assert house.daemon.process.wait(WAIT_S) == 1
        assert house.named() == DEAD_COVERS


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("name: C1", "name: Gate", "the configuration changed: "),
        ("host: 127.0.0.1", "host: 127.0.0.1, client_id: other", "starting anew with it"),
    ],
)
def test_a_reload_does_so_too_and_the_bridge_runs_on(
    tmp_path: Path, before: str, after: str, told: str
) -> None:
    """The line, or the whole bridge, is exchanged; what follows knows what was left."""
    with _house(tmp_path, LineProtocol.WISCO) as house:
        house.config.write_text(house.config.read_text().replace(before, after))
        house.daemon.signal(signal.SIGHUP)
        house.wait_off(LIVE, time.monotonic())
        house.daemon.wait_for_log(told)
        deadline = time.monotonic() + WAIT_S
        while house.daemon.log.count(" is open") < 2:
            assert time.monotonic() < deadline, house.daemon.log
            time.sleep(0.01)  # a file does not tell that it grew: it is looked at again
        assert house.named() == DEAD_COVERS
        assert house.daemon.stop()[0] == 1
        assert house.named() == 2 * DEAD_COVERS


def test_a_stop_with_nothing_but_live_motors_is_clean_and_quick(tmp_path: Path) -> None:
    """Twelve motors of two modules stand within a second or two; the exit is 0."""
    with _house(tmp_path, LineProtocol.MODBUS_RTU) as house:
        house.line.module(DEAD).away = False
        status, took_s = house.daemon.stop()
        assert (status, house.outputs(LIVE), house.outputs(DEAD)) == (0, 0, 0)
        assert took_s < WITHIN_S
        assert house.named() == 0
        assert "Traceback" not in house.daemon.log
