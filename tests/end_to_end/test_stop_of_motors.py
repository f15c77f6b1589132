"""SIGTERM and SIGHUP while motors run and modules are dead: the real daemon, on simulated lines."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.daemon import WAIT_S
from support.panel import BASE, House, house

from bridge.model import LineProtocol

LIVE, DEAD = 1, 2
LIVE_COVERS, DEAD_COVERS = 4, 8
WITHIN_S = 3.0
OPENING = 0b0101_0101_0101_0101


def _wait_off(house: House, since: float) -> None:
    """Wait until the motors of the live module stand, which is to be in time."""
    house.wait(lambda: not house.line.module(LIVE).outputs)
    assert time.monotonic() < since + WITHIN_S, house.daemon.log


def _named(house: House) -> int:
    """Return how many covers of the dead module the log names as left."""
    lines = house.daemon.log.splitlines()
    return sum("(pumps): cover" in line and "may still move" in line for line in lines)


def _covers(count: int) -> str:
    covers = (
        f"c{n}: {{name: C{n}, open: {2 * n - 1}, close: {2 * n}, "
        "open_time: 120s, close_time: 120s}"
        for n in range(1, count + 1)
    )
    return f"covers: {{{', '.join(covers)}}}"


@contextmanager
def _moving(directory: Path, protocol: LineProtocol) -> Iterator[House]:
    """All twelve covers move, and the module with eight of them died just now."""
    covers = {"garage": LIVE_COVERS, "pumps": DEAD_COVERS}
    keys = {station_id: _covers(count) for station_id, count in covers.items()}
    with house(directory, protocol, **keys) as running:
        for address, outputs in ((LIVE, 0xFF), (DEAD, 0xFFFF)):
            running.line.module(address).write_outputs(outputs, OPENING & outputs, b"")
        for station_id, count in covers.items():
            for n in range(1, count + 1):
                running.probe.wait_message(f"{BASE}/{station_id}/cover/c{n}/state", "opening")
        running.line.module(DEAD).away = True
        yield running


def test_a_stop_stops_the_live_motors_names_the_others_and_ends_with_1(tmp_path: Path) -> None:
    """A module with eight moving covers died just now: the four of the other one are stopped."""
    with _moving(tmp_path, LineProtocol.MODBUS_RTU) as running:
        running.daemon.signal(signal.SIGTERM)
        _wait_off(running, time.monotonic())
        assert running.daemon.process.wait(WAIT_S) == 1
        assert _named(running) == DEAD_COVERS


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
    with _moving(tmp_path, LineProtocol.WISCO) as running:
        running.reload(before, after)
        _wait_off(running, time.monotonic())
        running.daemon.wait_for_log(told)
        running.wait(lambda: running.daemon.log.count(" is open") == 2)
        assert _named(running) == DEAD_COVERS
        assert running.daemon.stop()[0] == 1
        assert _named(running) == 2 * DEAD_COVERS


def test_a_stop_with_nothing_but_live_motors_is_clean_and_quick(tmp_path: Path) -> None:
    """Twelve motors of two modules stand within a second or two; the exit is 0."""
    with _moving(tmp_path, LineProtocol.MODBUS_RTU) as running:
        running.line.module(DEAD).away = False
        status, took_s = running.daemon.stop()
        outputs = [running.line.module(address).outputs for address in (LIVE, DEAD)]
        assert (status, outputs) == (0, [0, 0])
        assert took_s < WITHIN_S
        assert _named(running) == 0
        assert "Traceback" not in running.daemon.log
