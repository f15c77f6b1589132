"""A cover through frames, a real mosquitto and the real daemon: the simulator counts the orders."""

from pathlib import Path
from typing import Any

from support.daemon import WAIT_S
from support.panel import BASE, House, house, is_complete, results

from bridge.model import LineProtocol

COVER = f"{BASE}/garage/cover/shutter"
OPEN_S, OVERRUN_S, DEAD_S = 2.0, 0.5, 0.3
SLACK_S = 1.5  # a busy machine
LATENCY_S = 0.2  # ON may have been obeyed later than OFF, each after it was sent
GARAGE = (
    f"interlock_dead_time: {DEAD_S}s, covers: {{shutter: "
    f"{{name: Shutter, open: 1, close: 2, open_time: {OPEN_S}s, close_time: 1500ms}}}}"
)


def _command(house: House, word: str | int) -> dict[str, Any]:
    if isinstance(word, int):
        return house.command("garage/cover/shutter/position/set", {"position": word})
    return house.command("garage/cover/shutter/set", {"state": word})


def _moves(house: House) -> list[tuple[int, bool]]:
    return [(order.output, order.value) for order in house.orders()]


def _check(house: House) -> None:
    """Never two directions ON, and the dead time between one and the other."""
    outputs, off_at = 0, {1: 0.0, 2: 0.0}
    for order in house.orders():
        if order.value:
            other = 3 - order.output
            assert not outputs & other, "both directions were ON"
            assert order.at - off_at[other] >= DEAD_S
            outputs |= order.output
        elif outputs & order.output:
            outputs &= ~order.output
            off_at[order.output] = order.at


def test_a_cover_opens_reverses_and_stops(tmp_path: Path) -> None:
    """Each command is one verdict; states are retained; the motor is OFF at the end of its way."""
    with house(tmp_path, LineProtocol.WISCO, garage=GARAGE) as running:
        probe = running.probe
        probe.wait_message(f"{COVER}/state", "None")
        assert _command(running, 50)["reason"] == "busy"
        opened = _command(running, "OPEN")
        assert (opened["target"], opened["payload"], opened["status"]) == (
            "cover/shutter", "OPEN", "done",
        )  # fmt: skip
        probe.wait_message(f"{COVER}/state", "opening")
        probe.wait_message(f"{COVER}/state", "open")
        probe.wait_message(f"{COVER}/position", "100")
        assert _command(running, "CLOSE")["status"] == "done"
        assert _command(running, "OPEN")["status"] == "done"
        assert _command(running, "STOP")["status"] == "done"
        assert running.line.module(1).outputs == 0
        probe.wait_message(f"{COVER}/state", "stopped")
        assert _command(running, 10)["status"] == "done"
        running.wait(lambda: _moves(running)[-2:] == [(2, True), (2, False)])
    first, off = running.orders()[:2]
    assert off.at - first.at - OVERRUN_S + LATENCY_S >= OPEN_S
    assert off.at - first.at <= OPEN_S + OVERRUN_S + SLACK_S
    assert _moves(running)[:6] == [
        (1, True), (1, False), (2, True), (2, False), (1, True), (1, False),
    ]  # fmt: skip
    _check(running)


def test_a_retained_command_moves_nothing(tmp_path: Path) -> None:
    """A retained command moves no cover: neither the stored copy at each start nor a live one."""
    with house(tmp_path, LineProtocol.MODBUS_RTU, garage=GARAGE) as running:
        probe = running.probe
        for topic, payload in (("set", "OPEN"), ("position/set", "0")):
            probe.publish(f"{COVER}/{topic}", payload, retain=True)
        refused = probe.wait_for(lambda seen: len(results(seen)) == 2)
        assert {v["reason"] for v in results(refused)} == {"retained"}
        running.daemon.stop()
        with running.daemon:
            probe.wait_for(lambda seen: is_complete(seen[len(refused) :]))
            assert _command(running, "STOP")["status"] == "done"
    assert _moves(running) == [(1, False)]


def test_a_restart_keeps_where_a_cover_stands_and_a_kill_does_not(tmp_path: Path) -> None:
    """The file of a stop is used once; at a kill nothing says that the motor stood."""
    with house(tmp_path, LineProtocol.MODBUS_RTU, garage=GARAGE) as running:
        _command(running, "OPEN")
        running.probe.wait_message(f"{COVER}/state", "open")
        running.daemon.stop()
        with running.daemon:
            _wait_shown(running, "open")
            assert _command(running, 50)["status"] == "done"
            running.wait(lambda: running.line.module(1).outputs == 0)
            running.daemon.process.kill()
            running.daemon.process.wait(WAIT_S)
        with running.daemon:
            _wait_shown(running, "None")


def _wait_shown(house: House, state: str) -> None:
    """Waits for a state that is told since a complete start."""
    began = len(house.probe.seen)
    house.probe.wait_for(lambda seen: is_complete(seen[began:]))
    told = [m.payload.decode() for m in house.probe.seen[began:] if m.topic == f"{COVER}/state"]
    assert told[-1:] == [state]


def test_a_start_after_a_kill_ends_what_moves_and_moves_nothing(tmp_path: Path) -> None:
    """The output was left ON: it is said, and goes OFF after the time of the whole way."""
    with house(tmp_path, LineProtocol.MODBUS_RTU, garage=GARAGE) as running:
        _command(running, "OPEN")
        running.daemon.process.kill()
        running.daemon.process.wait(WAIT_S)
        assert running.line.module(1).outputs == 1
        with running.daemon as again:
            running.wait(lambda: _moves(running) == [(1, True), (1, False)])
            again.wait_for_log("cover shutter moves unasked")
            running.probe.wait_message(f"{COVER}/state", "open")
    assert running.line.module(1).outputs == 0
