"""F5, F6, F7, F9, F10, F21: messages that arrive late, or again."""

import json
import signal
import socket
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from support.daemon import WAIT_S, Daemon
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, STATIONS, broker, is_complete, panel, results, write_config
from support.sent_commands import OUTPUTS, verdicts, wait_until_fresh
from support.tcp_relay import TcpRelay
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import OnLossConfig, OutputConfig
from bridge.hub.memory import Loss
from bridge.model import LineProtocol
from bridge.mqtt.link import LinkCheck
from bridge.simulator.faults import is_write
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Switching
from proofs import shifted_daemon
from proofs.figures import Figure, Run, proof
from proofs.forgetful_broker import ForgetfulBroker
from proofs.relayed_panel import ENVIRON, IMPATIENT
from proofs.shifted_daemon import write_shifts
from proofs.systemd_socket import systemd_socket, wait_ready

# --- F5 ---------------------------------------------------------------------------------------

_AFTER_S = 2


def _edited(config: Path, number: int) -> None:
    """Change the line of the panel, and at every third time the client at the broker."""
    text = config.read_text()
    lines = [line for line in text.splitlines() if "turnaround" not in line]
    at = next(n for n, line in enumerate(lines) if "baud" in line)
    lines.insert(at, f"    turnaround: {number % 9 + 1}ms")
    if number % 3 == 2:
        lines[0] = lines[0].split(", client_id")[0].rstrip("}") + f", client_id: c{number}}}"
    config.write_text("\n".join(lines) + "\n")


def _reload(daemon: Daemon, systemd: socket.socket, config: Path, number: int) -> None:
    _edited(config, number)
    daemon.signal(signal.SIGHUP)
    wait_ready(systemd)


@proof("F5")
def reloads_in_a_loss(run: Run) -> Figure:
    """An order of `on_loss` is made once a loss, however often the configuration is read."""
    times = run.scale.of(3, 10)
    with (
        panel(LineProtocol.MODBUS_RTU) as line,
        broker(run.directory) as mosquitto,
        systemd_socket(run.directory) as systemd,
    ):
        config = write_config(run.directory, line, mosquitto.port)
        outputs = f'outputs: {{4: {{on_loss: {{state: "ON", after: {_AFTER_S}s}}}}}}'
        text = config.read_text().replace("id: garage}", f"id: garage, {outputs}}}")
        config.write_text(text)
        with (
            MqttProbe(mosquitto.port, f"{BASE}/#") as probe,
            Daemon(config, notify=systemd) as daemon,
        ):
            probe.wait_for(is_complete)
            wait_ready(systemd)
            mosquitto.stop()
            _wait_for_orders(line, 1)
            for number in range(times):
                _reload(daemon, systemd, config, number)
            line.module(1).set_output(4, False)
            _reload(daemon, systemd, config, times)
            daemon.wait_for_log("is open")
        orders = len(_orders(line))
    return Figure(
        injected=f"{times + 1} reloads in one loss, every third of mqtt:",
        seen=f"{orders} transmission",
        promised="one transmission a loss",
        kept=orders == 1,
    )


def _orders(line: SimulatedLine) -> list[Switching]:
    return [switching for switching in line.module(1).switchings if switching.frame]


def _wait_for_orders(line: SimulatedLine, count: int) -> None:
    deadline = time.monotonic() + WAIT_S
    while len(_orders(line)) < count:
        assert time.monotonic() < deadline
        time.sleep(0.01)  # a relay tells nobody that it moved: it is looked at again


# --- F6 ---------------------------------------------------------------------------------------


def _fires_after(after_s: float, reconnect_s: float) -> float:
    """Return when `on_loss` fired, counted from when a broker went mute that takes connections."""
    output = OutputConfig(3, on_loss=OnLossConfig(after_s, on=True))
    worker = VirtualWorker(make_line(make_station(outputs=(output,))))
    link, loss, mute_at = LinkCheck("run"), Loss(), 110.0

    def round_of_the_main_loop() -> None:
        now = worker.line.now
        since_mute_s = now - mute_at
        if now < mute_at and worker.line.now <= 100.1:
            link.connected(now)
        elif since_mute_s >= 0 and since_mute_s % reconnect_s < 0.1:
            link.disconnected()
            link.connected(now)
        ping = link.ping(now)
        if ping is not None and now < mute_at:
            link.seen(ping, now)
        if loss.turn(away=link.away(now), now=now):
            worker.worker.broker(loss.since)

    until = mute_at + after_s + 40.0
    for tenth in range(round((until - 100.0) * 10)):
        worker.line.at(100.0 + tenth / 10, round_of_the_main_loop)
    worker.run(until)
    fired = [at for at, frame in worker.line.wire if is_write(frame)]
    return fired[0] - mute_at if len(fired) == 1 else float("inf")


@proof("F6")
def a_mute_broker_is_away(run: Run) -> Figure:
    """A broker that takes CONNECT and SUBSCRIBE, and then says nothing, is away."""
    afters = (5.0, 30.0) if run.scale.of(0, 1) == 0 else (5.0, 15.0, 26.0, 30.0, 60.0, 120.0)
    periods = (3.0, 8.0, 26.0)
    late = [_fires_after(after_s, period) - after_s for after_s in afters for period in periods]
    return Figure(
        injected=f"mute broker, after {afters[0]:.0f}-{afters[-1]:.0f} s, connects each 3-26 s",
        seen=f"{len(late)} losses, each fired once, at most {max(late):.1f} s after `after`",
        promised="within 5 s of `after`",
        kept=max(late) <= 5.0 and min(late) >= 0.0,
    )


# --- F7 ---------------------------------------------------------------------------------------

_SUSPEND_S = 15.0
_ON_THE_WIRE_S = 0.2  # longer than a request with its reply


def _suspend(
    daemon: Daemon, line: SimulatedLine, probe: MqttProbe, shifts: Path, number: int
) -> float:
    """Suspend the daemon while commands are under way; return when it woke up."""
    marks = [f"{number}-{n}" for n in range(16)]
    for n, command_id in enumerate(marks[:6]):
        _send(probe, n, command_id)
    daemon.signal(signal.SIGSTOP)
    for n, command_id in enumerate(marks[6:], 6):
        _send(probe, n, command_id)
    _wait_until_passed(line)
    write_shifts(shifts, _SUSPEND_S * (number + 1), 0.0)
    woke_at = time.monotonic()
    daemon.signal(signal.SIGCONT)
    probe.wait_for(lambda seen: all(len(verdicts(seen, command_id)) == 1 for command_id in marks))
    return woke_at


def _wait_until_passed(line: SimulatedLine) -> None:
    """Wait until the module has what was sent before the suspend: the wire does not stop."""
    seen = -1
    while seen != (seen := len(line.log)):
        time.sleep(_ON_THE_WIRE_S)


def _send(probe: MqttProbe, n: int, command_id: str) -> None:
    wish = json.dumps(
        {
            "state": "ON" if int(command_id.split("-", maxsplit=1)[0]) % 2 == 0 else "OFF",
            "id": command_id,
        }
    )
    probe.publish(f"{BASE}/pumps/do/{n + 1}/set", wish)


@proof("F7")
def a_suspend(run: Run) -> Figure:
    """Commands that waited during a suspend of the machine are refused after it."""
    times = run.scale.of(2, 40)
    shifts = run.directory / "shifts"
    write_shifts(shifts, 0.0, 0.0)
    late, done = 0, 0
    program = (str(Path(shifted_daemon.__file__).resolve()), str(shifts))
    with panel(LineProtocol.MODBUS_RTU) as line, broker(run.directory) as mosquitto:
        config = write_config(run.directory, line, mosquitto.port)
        with (
            MqttProbe(mosquitto.port, f"{BASE}/#") as probe,
            Daemon(config, program=program, environ=ENVIRON) as daemon,
        ):
            probe.wait_for(is_complete)
            for number in range(times):
                wait_until_fresh(probe)
                probe.clear()
                woke_at = _suspend(daemon, line, probe, shifts, number)
                orders = [s for s in line.module(2).switchings if s.frame]
                late += sum(order.at > woke_at for order in orders)
                done += sum(verdict["status"] == "done" for verdict in results(probe.seen))
            wait_until_fresh(probe)
            assert "was suspended for 15 s" in daemon.log
            assert daemon.stop()[0] == 0
    return Figure(
        injected=f"{times} suspends of {_SUSPEND_S:.0f} s with {16 * times} commands under way",
        seen=f"{late} executed late, {done} done before, one verdict each",
        promised="0 executed late",
        kept=late == 0,
    )


# --- F9 ---------------------------------------------------------------------------------------


@proof("F9")
def an_id_outlives_every_reload(run: Run) -> Figure:
    """A command with an id that was seen is a duplicate after every kind of reload."""
    times = run.scale.of(3, 12)
    with (
        panel(LineProtocol.MODBUS_RTU) as line,
        broker(run.directory) as mosquitto,
        systemd_socket(run.directory) as systemd,
    ):
        line.module(1).set_mode(1, pulse=True)
        config = write_config(run.directory, line, mosquitto.port)
        with (
            MqttProbe(mosquitto.port, f"{BASE}/#") as probe,
            Daemon(config, notify=systemd) as daemon,
        ):
            probe.wait_for(is_complete)
            wait_ready(systemd)
            again: list[object] = []
            for number in range(times):
                command_id = f"pulse {number}"
                wait_until_fresh(probe)
                again.append(_press(probe, command_id)["status"])
                probe.clear()
                _reload(daemon, systemd, config, number)
                probe.wait_message(f"{BASE}/garage/availability", "online")
                wait_until_fresh(probe)
                again.append(_press(probe, command_id).get("reason"))
        pulses = len(_orders(line))
    return Figure(
        injected=f"{times} pulses, each id again after a reload, every third of mqtt:",
        seen=f"{pulses} ONs, {again.count('duplicate')} duplicates",
        promised="one execution an id",
        kept=pulses == times and again == ["done", "duplicate"] * times,
    )


def _press(probe: MqttProbe, command_id: str) -> dict[str, object]:
    probe.clear()
    probe.publish(f"{BASE}/garage/do/1/set", json.dumps({"state": "PRESS", "id": command_id}))
    seen = probe.wait_for(lambda seen: bool(verdicts(seen, command_id)))
    return verdicts(seen, command_id)[0]


# --- F10 --------------------------------------------------------------------------------------


def _stored() -> Iterator[tuple[str, bytes]]:
    for name, n in OUTPUTS:
        yield f"{BASE}/{name}/do/{n}/set", b"ON"
        yield f"{BASE}/{name}/do/{n}/mode/set", b"pulse"
    for name, (_, model) in STATIONS.items():
        everything = {str(n): "ON" for n in range(1, model.outputs + 1)}
        yield f"{BASE}/{name}/set", json.dumps({"do": everything}).encode()


@proof("F10")
def stored_commands_without_their_flag(run: Run) -> Figure:
    """A broker that delivers what it stored as if it were new switches nothing."""
    times = run.scale.of(2, 100)
    orders, refused = 0, 0
    program = (str(IMPATIENT),)
    for mqtt in ("5", "3.1.1"):
        directory = run.directory / mqtt
        directory.mkdir()
        with (
            panel(LineProtocol.MODBUS_RTU) as line,
            ForgetfulBroker(f"{BASE}/bridge/ping", list(_stored())) as stand_in,
            TcpRelay(stand_in.port) as relay,
        ):
            config = write_config(directory, line, relay.port)
            text = config.read_text()
            config.write_text(text.replace("127.0.0.1,", f'127.0.0.1, protocol: "{mqtt}",'))
            with Daemon(config, program=program, environ=ENVIRON) as daemon:
                for number in range(times):
                    stand_in.wait_for_online(number + 1)
                    relay.cut()
                daemon.stop()
            orders += sum(s.frame is not None for m in (1, 2) for s in line.module(m).switchings)
            orders += sum(line.module(m).eeprom_writes for m in (1, 2))
            refused += stand_in.refusals
    stored = len(list(_stored()))
    return Figure(
        injected=f"ON without its flag on {stored} topics, {times} connects, v5 and 3.1.1",
        seen=f"{orders} writes, {refused} refused",
        promised="0 writes",
        kept=orders == 0 and refused >= 2 * times * stored,
    )


# --- F21 --------------------------------------------------------------------------------------

_WRONG_S = 210 * 86_400.0


def _times(seen: list[Seen]) -> list[datetime]:
    """Return the start of the bridge, and since when a station has its problem, as told last."""
    latest = {message.topic: message.text for message in seen}
    info = json.loads(latest[f"{BASE}/bridge/info"])
    problem = json.loads(latest[f"{BASE}/garage/problem"])
    return [datetime.fromisoformat(info["started"]), datetime.fromisoformat(problem["since"])]


def _is_right(seen: list[Seen], began: datetime) -> bool:
    return all(abs((at - began).total_seconds()) < WAIT_S for at in _times(seen))


@proof("F21")
def the_clock_was_wrong_at_boot(run: Run) -> Figure:
    """Times that were told under a wrong clock are told anew when it is set."""
    shifts = run.directory / "shifts"
    write_shifts(shifts, 0.0, -_WRONG_S)
    program = (str(Path(shifted_daemon.__file__).resolve()), str(shifts))
    with panel(LineProtocol.MODBUS_RTU) as line, broker(run.directory) as mosquitto:
        config = write_config(run.directory, line, mosquitto.port)
        text = config.read_text()
        config.write_text(
            text.replace("id: garage}", "id: garage, outputs: {1: {mode: pulse, hold: 2s}}}")
        )
        began = datetime.now(UTC)
        with (
            MqttProbe(mosquitto.port, f"{BASE}/#") as probe,
            Daemon(config, program=program, environ=ENVIRON),
        ):
            probe.wait_for(is_complete)
            wrong = _times(probe.seen)
            write_shifts(shifts, 0.0, 0.0)
            set_at = time.monotonic()
            probe.wait_for(lambda seen: _is_right(seen, began))
            took_s = time.monotonic() - set_at
    days = min((began - at).days for at in wrong)
    return Figure(
        injected=f"started {days} days in the past, clock set later",
        seen=f"started and since right after {took_s:.1f} s",
        promised="right within 5 s",
        kept=days >= 209 and took_s <= 5.0,
    )
