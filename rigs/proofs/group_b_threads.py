"""A thread that dies or is held up by what arrives: B1, B7."""

import json
import queue
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Self
from unittest.mock import patch

from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, STATIONS, is_complete, panel, write_config

from bridge.config.schema import MqttConfig
from bridge.model import LineProtocol
from bridge.mqtt import client as client_module
from bridge.mqtt.client import MqttClient
from bridge.mqtt.connection import Connection
from bridge.mqtt.events import Acknowledged, MqttEvent, OutMessage, Subscription
from bridge.mqtt.outbox import WINDOW
from bridge.simulator.line import SimulatedLine
from proofs import dying_bridge
from proofs.figures import Figure, Run, proof
from proofs.hostile_messages import hostile

# --- B1 ---------------------------------------------------------------------------------------

ENDS_WITHIN_S = 15.0
COMMANDS = tuple(
    topic
    for name, (_, model) in STATIONS.items()
    for topic in (
        f"{BASE}/{name}/set",
        *(f"{BASE}/{name}/do/{n}/set" for n in range(1, model.outputs + 2)),
    )
)
# The broker is to pass everything on, however fast it comes.
PATIENT = ("max_queued_messages 0", "max_inflight_messages 0")
AT_A_TIME = 500
BUNDLE_S = 60.0
AFTERWARDS = f"{BASE}/pumps/do/16"


def _flood(sender: MqttProbe, results: MqttProbe, count: int) -> None:
    """Publishes that many hostile messages; waits now and then until the bridge has read them."""
    chance = random.Random(1)  # noqa: S311  # damage, not secrets
    for n in range(count):
        message = hostile(chance, BASE, COMMANDS)
        sender.publish(message.topic, message.payload, qos=0, retain=message.retain)
        if n % AT_A_TIME == 0:
            mark = f"bundle {n}"
            sender.publish(f"{AFTERWARDS}/set", json.dumps({"id": mark}))
            results.wait_for(partial(_is_answered, mark=mark.encode()), BUNDLE_S)


def _is_answered(seen: list[Seen], mark: bytes) -> bool:
    return any(mark in message.payload for message in seen[-2 * AT_A_TIME :])


def _orders(line: SimulatedLine) -> int:
    """Return the orders to outputs, except the one that is switched afterwards."""
    orders = sum(module.ordered.total() for module in line.modules.values())
    return orders - line.module(2).ordered[16, True]


def _works(sender: MqttProbe, port: int) -> bool:
    """Return whether a command is carried out, at the latest after the flood."""
    with MqttProbe(port, AFTERWARDS) as probe:
        for _ in range(60):
            sender.publish(f"{AFTERWARDS}/set", "ON")
            try:
                probe.wait_message(AFTERWARDS, "ON", 1.0)
            except AssertionError:
                continue
            return True
    return False


def _messages(run: Run, count: int) -> tuple[int, int, int, int]:
    """Returns deaths, frames that wrote, callbacks that raised, and verdicts."""
    mosquitto = Mosquitto(run.directory / "mosquitto", options=PATIENT)
    mosquitto.start()
    with panel(LineProtocol.WISCO) as line:
        config = write_config(run.directory, line, mosquitto.port)
        with MqttProbe(mosquitto.port) as sender, Daemon(config, "--log-level=warning") as daemon:
            with MqttProbe(mosquitto.port, f"{BASE}/#") as probe:
                probe.wait_for(is_complete)
            with MqttProbe(mosquitto.port, f"{BASE}/+/result") as probe:
                _flood(sender, probe, count)
                works = _works(sender, mosquitto.port)
                verdicts = len(probe.seen)
            dead = not works or daemon.process.poll() is not None
            raised = daemon.log.count("MQTT callback") + daemon.log.count("Traceback")
        writes = _orders(line)
    mosquitto.stop()
    return int(dead), writes, raised, verdicts


def _forced_death(directory: Path, thread: str) -> float | None:
    """Return how long the bridge outlived its thread; None: no exit 1, or no named cause."""
    directory.mkdir()
    mosquitto = Mosquitto(directory / "mosquitto")
    mosquitto.start()
    with panel(LineProtocol.MODBUS_RTU) as line:
        config = write_config(directory, line, mosquitto.port)
        program = (dying_bridge.__file__, thread)
        with Daemon(config, program=program) as daemon:
            began = time.monotonic()
            try:
                status = daemon.process.wait(ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                status = None
            took_s = time.monotonic() - began
            named = dying_bridge.CAUSE in daemon.log
    mosquitto.stop()
    return took_s if status == 1 and named else None


@proof("B1")
def nothing_dies_in_silence(run: Run) -> Figure:
    """No message kills a thread; a thread that dies ends the process, with its cause named."""
    count = run.scale.of(500, 100_000)
    dead, writes, raised, verdicts = _messages(run, count)
    ends = [_forced_death(run.directory / thread, thread) for thread in dying_bridge.PLACES]
    ended = [end for end in ends if end is not None]
    return Figure(
        injected=f"{count} hostile messages; death of {', '.join(dying_bridge.PLACES)} thread",
        seen=f"{dead} deaths, {writes} writes, {verdicts} refusals; {len(ended)} x exit 1 "
        f"in {max(ended, default=0):.1f} s",
        promised="0 deaths, 0 writes; exit 1, cause named, 15 s",
        # Seven of ten messages come on the topics of commands that are there.
        kept=(dead, writes, raised) == (0, 0, 0) and verdicts > count / 2 and None not in ends,
    )


# --- B7 ---------------------------------------------------------------------------------------

LONGEST_S = 0.005
SWITCH_S = 0.0001
TOPIC = "b/garage/do/1/set"


class _Stopwatch:
    """Measures callbacks: by the time of their thread, and by the wall clock.

    On the wall clock a busy machine delays every callback, by its scheduler and by that of the
    interpreter, which is set to be quick here. A callback that waits does so each time.

    Attributes:
        calls: The number of callbacks.
        longest_s: The longest one, in the time of its thread.
        held_up: How many took too long by the wall clock.
    """

    def __init__(self) -> None:
        self.calls = 0
        self.longest_s = 0.0
        self.held_up = 0
        self._interval_s = sys.getswitchinterval()

    def __enter__(self) -> Self:
        sys.setswitchinterval(SWITCH_S)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setswitchinterval(self._interval_s)

    def around(self, callback: Callable[..., None]) -> Callable[..., None]:
        """The same callback, timed."""

        def timed(*arguments: Any) -> None:
            cpu_s, wall_s = time.thread_time(), time.monotonic()
            callback(*arguments)
            cpu_s, wall_s = time.thread_time() - cpu_s, time.monotonic() - wall_s
            self.calls += 1
            self.longest_s = max(self.longest_s, cpu_s)
            self.held_up += wall_s >= LONGEST_S

        return timed


def _timed(watch: _Stopwatch) -> type[Connection]:
    class TimedConnection(Connection):
        """A connection whose callbacks are timed."""

        connected = watch.around(Connection.connected)
        subscribed = watch.around(Connection.subscribed)
        published = watch.around(Connection.published)
        arrived = watch.around(Connection.arrived)

    return TimedConnection


def _drain(
    events: "queue.Queue[MqttEvent | None]", arrived: threading.Semaphore, room: threading.Semaphore
) -> None:
    """The main thread's part: takes what comes."""
    while (event := events.get()) is not None:
        arrived.release()
        if isinstance(event, Acknowledged):
            room.release()


@proof("B7")
def callbacks_do_not_wait(run: Run) -> Figure:
    """A burst in both directions: no callback of the client takes long."""
    count = run.scale.of(1_000, 50_000)
    mosquitto = Mosquitto(run.directory / "mosquitto", options=PATIENT)
    mosquitto.start()
    watch = _Stopwatch()
    events: queue.Queue[MqttEvent | None] = queue.Queue()
    arrived = threading.Semaphore(0)
    room = threading.Semaphore(WINDOW)  # as much as the outbox hands over at a time
    drain = threading.Thread(target=_drain, args=(events, arrived, room))
    drain.start()
    with watch, patch.object(client_module, "Connection", _timed(watch)):
        config = MqttConfig("127.0.0.1", mosquitto.port, "b", "under-test", "auto")
        client = MqttClient(config, [Subscription("b/+/do/+/set")], events.put, None)
        client.start()
        assert arrived.acquire(timeout=20), "not connected"
        for n in range(count):
            assert room.acquire(timeout=20), "not acknowledged"
            client.publish(OutMessage("b/garage/do/1", b"%d" % n, qos=1, retain=False))
        sender = ["mosquitto_pub", "-p", str(mosquitto.port), "-q", "1", "-t", TOPIC, "-l"]
        subprocess.run(sender, input=b"ON\n" * count, check=True)
        complete = all(arrived.acquire(timeout=20) for _ in range(2 * count))
        client.stop(5)
    events.put(None)
    drain.join()
    mosquitto.stop()
    return Figure(
        injected=f"{count} messages in, {count} out, as fast as they go",
        seen=f"longest of {watch.calls} callbacks {watch.longest_s * 1000:.2f} ms, "
        f"{watch.held_up} held up",
        promised=f"under {LONGEST_S * 1000:.0f} ms",
        kept=complete
        and watch.calls >= 2 * count
        and watch.longest_s < LONGEST_S
        and watch.held_up < watch.calls / 100,
    )
