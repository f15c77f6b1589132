"""A cover through frames, a real mosquitto and the real daemon: the simulator counts the orders."""

import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from support.brokers import Broker
from support.daemon import WAIT_S, Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, broker, is_complete, panel, results, write_config

from bridge.model import LineProtocol
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Switching

COVER = f"{BASE}/garage/cover/shutter"
OPEN_S, CLOSE_S, OVERRUN_S, DEAD_S = 2.0, 1.5, 0.5, 0.3
SLACK_S = 1.5  # a busy machine
LATENCY_S = 0.2  # ON may have been obeyed later than OFF, each after it was sent


@dataclass
class House:
    """A daemon with the cover `shutter` at outputs 1 (open) and 2 (close) of `garage`."""

    line: SimulatedLine
    mosquitto: Broker
    probe: MqttProbe
    daemon: Daemon
    config: Path
    marks: "count[int]"

    def command(self, word: str | int, topic: str = "set") -> dict[str, Any]:
        """Publishes a command to the cover; returns its verdict."""
        mark = f"c{next(self.marks)}"
        key = "position" if topic == "position/set" else "state"
        self.probe.publish(f"{COVER}/{topic}", json.dumps({key: word, "id": mark}))
        return self.verdict(mark)

    def verdict(self, mark: str) -> dict[str, Any]:
        """The verdict on the command with this mark."""
        seen = self.probe.wait_for(lambda seen: any(v.get("id") == mark for v in results(seen)))
        (verdict,) = (v for v in results(seen) if v.get("id") == mark)
        return verdict

    def orders(self) -> list[Switching]:
        """Return the orders of frames to the two outputs."""
        return [s for s in self.line.module(1).switchings if s.frame and s.output in {1, 2}]

    def moves(self) -> list[tuple[int, bool]]:
        """The same without the instants."""
        return [(order.output, order.value) for order in self.orders()]

    def wait(self, condition: Callable[[], bool]) -> None:
        """Wait until something is true at the module, which sends no events."""
        deadline = time.monotonic() + WAIT_S
        while not condition():
            assert time.monotonic() < deadline, f"orders: {self.orders()}"
            time.sleep(0.01)

    def check(self) -> None:
        """Never two directions ON, and the dead time between one and the other."""
        outputs, off_at = 0, {1: 0.0, 2: 0.0}
        for order in self.line.module(1).switchings:
            if order.output not in off_at:
                continue
            if order.value:
                other = 3 - order.output
                assert not outputs & other, "both directions were ON"
                assert order.at - off_at[other] >= DEAD_S
                outputs |= order.output
            elif outputs & order.output:
                outputs &= ~order.output
                off_at[order.output] = order.at


@contextmanager
def _house(directory: Path, protocol: LineProtocol, **faults: Any) -> Iterator[House]:
    with panel(protocol) as line, broker(directory) as mosquitto:
        config = write_config(directory, line, mosquitto.port)
        cover = (
            f"{{name: Shutter, open: 1, close: 2, open_time: {OPEN_S}s, close_time: {CLOSE_S}s}}"
        )
        station = f"id: garage, interlock_dead_time: {DEAD_S}s, covers: {{shutter: {cover}}}}}"
        config.write_text(config.read_text().replace("id: garage}", station))
        if faults:
            line.faults.set(**faults)
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config) as daemon:
            probe.wait_for(is_complete)
            yield House(line, mosquitto, probe, daemon, config, count())


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_a_cover_opens_reverses_and_stops(tmp_path: Path, protocol: LineProtocol) -> None:
    """Each command is one verdict; states are retained; the motor is OFF at the end of its way."""
    with _house(tmp_path, protocol) as house:
        house.probe.wait_message(f"{COVER}/state", "None")
        assert house.command(50, "position/set")["reason"] == "busy"
        opened = house.command("OPEN")
        assert (opened["target"], opened["payload"], opened["status"]) == (
            "cover/shutter", "OPEN", "done",
        )  # fmt: skip
        house.probe.wait_message(f"{COVER}/state", "opening")
        house.probe.wait_message(f"{COVER}/state", "open")
        house.probe.wait_message(f"{COVER}/position", "100")
        assert house.command("CLOSE")["status"] == "done"
        assert house.command("OPEN")["status"] == "done"
        assert house.command("STOP")["status"] == "done"
        assert house.line.module(1).outputs == 0
        house.probe.wait_message(f"{COVER}/state", "stopped")
        assert house.command(10, "position/set")["status"] == "done"
        house.wait(lambda: house.moves()[-2:] == [(2, True), (2, False)])
    first, off = house.orders()[:2]
    assert off.at - first.at - OVERRUN_S + LATENCY_S >= OPEN_S
    assert off.at - first.at <= OPEN_S + OVERRUN_S + SLACK_S
    assert house.moves()[:6] == [
        (1, True), (1, False), (2, True), (2, False), (1, True), (1, False),
    ]  # fmt: skip
    house.check()


def test_its_outputs_are_not_switched_past_it(tmp_path: Path) -> None:
    """ON is refused and never sent; OFF is let through, and stops it."""
    with _house(tmp_path, LineProtocol.MODBUS_RTU) as house:
        house.probe.publish(f"{BASE}/garage/do/2/set", json.dumps({"state": "ON", "id": "raw"}))
        assert house.verdict("raw")["reason"] == "read_only"
        house.probe.publish(
            f"{BASE}/garage/do/1/mode/set", json.dumps({"mode": "pulse", "id": "m"})
        )
        assert house.verdict("m")["reason"] == "read_only"
        assert house.orders() == []
        house.command("OPEN")
        everything = {str(n): "OFF" for n in range(1, 9)}
        house.probe.publish(f"{BASE}/garage/set", json.dumps({"do": everything, "id": "all"}))
        assert house.verdict("all")["status"] == "done"
        house.probe.wait_message(f"{COVER}/state", "None")
    assert house.moves() == [(1, True), (1, False), (2, False)]


def test_a_retained_command_moves_nothing(tmp_path: Path) -> None:
    """A retained command moves no cover: neither the stored copy at each start nor a live one."""
    with _house(tmp_path, LineProtocol.MODBUS_RTU) as house:
        for topic, payload in (("set", "OPEN"), ("position/set", "0")):
            house.probe.publish(f"{COVER}/{topic}", payload, retain=True)
        refused = house.probe.wait_for(lambda seen: len(results(seen)) == 2)
        assert {v["reason"] for v in results(refused)} == {"retained"}
        house.daemon.stop()
        with house.daemon:
            house.probe.wait_for(lambda seen: is_complete(seen[len(refused) :]))
            assert house.command("STOP")["status"] == "done"
    assert house.moves() == [(1, False)]


def test_it_ends_its_way_when_the_broker_is_away(tmp_path: Path) -> None:
    """With the broker away, the motor still goes OFF at the end of its way."""
    with _house(tmp_path, LineProtocol.WISCO) as house:
        house.command("CLOSE")
        house.mosquitto.stop()
        house.wait(lambda: house.moves() == [(2, True), (2, False)])
        house.mosquitto.start()
        house.probe.wait_message(f"{COVER}/state", "closed")
        house.probe.wait_message(f"{COVER}/position", "0")
    on, off = house.orders()
    assert off.at - on.at - OVERRUN_S + LATENCY_S >= CLOSE_S
    assert off.at - on.at <= CLOSE_S + OVERRUN_S + SLACK_S


def test_a_clean_stop_switches_the_motor_off(tmp_path: Path) -> None:
    """SIGTERM while it moves: OFF goes out before the port is closed, and the exit is 0."""
    with _house(tmp_path, LineProtocol.WISCO) as house:
        house.command("OPEN")
        status, took_s = house.daemon.stop()
        assert (status, house.line.module(1).outputs) == (0, 0)
        assert took_s < 5.0
        house.probe.wait_message(f"{COVER}/state", "None")
    assert house.moves() == [(1, True), (1, False)]
    assert house.orders()[1].at - house.orders()[0].at < OPEN_S


@pytest.mark.parametrize(("own", "kept"), [(False, "main"), (True, "other")])
def test_a_reload_stops_the_motor_of_its_own_line_alone(
    tmp_path: Path, own: bool, kept: str
) -> None:
    """Another line is exchanged while it moves: it runs to its end. Its own: it is switched OFF."""
    other = (
        "  - {id: other, port: tcp://127.0.0.1:9, baud: 9600, protocol: wisco,\n"
        "     stations: [{address: 1, model: DIO100, id: annex}]}\n"
    )
    with _house(tmp_path, LineProtocol.WISCO) as house:
        house.config.write_text(house.config.read_text() + other)
        house.daemon.signal(signal.SIGHUP)
        house.daemon.wait_for_log("started: other")
        house.command("OPEN")
        old, new = ("name: Shutter", "name: Awning") if own else ("id: annex", "id: attic")
        house.config.write_text(house.config.read_text().replace(old, new))
        house.daemon.signal(signal.SIGHUP)
        house.daemon.wait_for_log(f"lines kept: {kept}; stopped: ")
        house.wait(lambda: house.moves() == [(1, True), (1, False)])
        house.probe.wait_message(f"{COVER}/state", "None" if own else "open")
    on, off = house.orders()
    assert (off.at - on.at < OPEN_S) is own


def test_a_start_after_a_kill_ends_what_moves_and_moves_nothing(tmp_path: Path) -> None:
    """The output was left ON: it is said, and goes OFF after the time of the whole way."""
    with _house(tmp_path, LineProtocol.MODBUS_RTU) as house:
        house.command("OPEN")
        house.daemon.process.kill()
        house.daemon.process.wait(WAIT_S)
        assert house.line.module(1).outputs == 1
        with house.daemon as again:
            house.wait(lambda: house.moves() == [(1, True), (1, False)])
            again.wait_for_log("cover shutter moves unasked")
            house.probe.wait_message(f"{COVER}/state", "open")
    assert house.line.module(1).outputs == 0


@pytest.mark.parametrize("kind", [FaultKind.SILENT, FaultKind.DEAF])
def test_lost_frames_leave_no_motor_on(tmp_path: Path, kind: FaultKind) -> None:
    """A third of the writes or of their replies is lost: one verdict each, never both ON."""
    losses: dict[str, Any] = {"kind": kind, "station": 1, "probability": 0.33, "only": is_write}
    with _house(tmp_path, LineProtocol.WISCO, **losses) as house:
        for word in ("OPEN", "CLOSE", "OPEN", "STOP", "CLOSE", "OPEN", "CLOSE"):
            house.command(word)
        house.wait(lambda: house.line.module(1).outputs == 0)
        verdicts = [v for v in results(house.probe.seen) if "by" not in v]
        assert house.line.faults.struck[kind] > 0
    assert len(verdicts) == 7
    house.check()
