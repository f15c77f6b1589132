"""Ports and links that go away, with and without a word: C3, C4."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from unittest.mock import patch

from support.daemon import Daemon
from support.event_log import EventLog
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe
from support.panel import BASE
from support.tcp_relay import TcpRelay, Way

from bridge.config.schema import MqttConfig
from bridge.model import DIO100, LineProtocol
from bridge.mqtt import wire
from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import Connected, Disconnected, OutMessage, Subscription
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from proofs.figures import Figure, Run, proof

# --- C3 ---------------------------------------------------------------------------------------

WITHIN_S = 5.0
BY_HAND = 3  # the output that somebody switched on


@dataclass(frozen=True, slots=True)
class _Adapter:
    """One line of its own, and how it is seen from outside."""

    line: SimulatedLine
    port: int

    def unplug_and_plug(self, count: int) -> list[tuple[float, float]]:
        """Does it that often; returns the seconds until it was seen as gone, and as back."""
        gone = f"{BASE}/bridge/line/{self.line.name}/availability"
        back = f"{BASE}/{self.line.name}-module/availability"
        with MqttProbe(self.port, gone, back) as probe:
            probe.wait_message(back, "online")
            return [
                (
                    _seconds_until(probe, gone, "offline", self.line.hang_up),
                    _seconds_until(probe, back, "online", self.line.restore),
                )
                for _ in range(count)
            ]


def _seconds_until(probe: MqttProbe, topic: str, payload: str, act: Callable[[], None]) -> float:
    probe.clear()
    began = time.monotonic()
    act()
    try:
        probe.wait_message(topic, payload, WITHIN_S)
    except AssertionError:
        return float("inf")
    return time.monotonic() - began


@contextlib.contextmanager
def _adapters(count: int, port: int) -> Iterator[list[_Adapter]]:
    with ExitStack() as stack:
        adapters = []
        for number in range(count):
            module = SimulatedModule(DIO100, address=1)
            line = SimulatedLine(LineProtocol.MODBUS_RTU, 9600, [module], name=f"l{number}")
            adapters.append(_Adapter(stack.enter_context(line), port))
            module.set_output(BY_HAND, True)
        yield adapters


def _configuration(adapters: list[_Adapter]) -> str:
    lines = "".join(
        f"  - id: {line.name}\n    port: {line.port}\n    baud: 9600\n    protocol: modbus-rtu\n"
        f"    stations: [{{address: 1, model: DIO100, id: {line.name}-module}}]\n"
        for line in (adapter.line for adapter in adapters)
    )
    return f"mqtt: {{host: 127.0.0.1, port: {adapters[0].port}}}\nlines:\n{lines}"


def _open_descriptors(daemon: Daemon) -> int:
    return len(os.listdir(f"/proc/{daemon.process.pid}/fd"))  # noqa: PTH208  # /proc, not files


@proof("C3")
def adapters_are_pulled_out(run: Run) -> Figure:
    """A port that vanishes is told, comes back by itself, leaks nothing and switches nothing."""
    lines, each = run.scale.of(2, 5), run.scale.of(1, 100)
    mosquitto = Mosquitto(run.directory / "mosquitto")
    mosquitto.start()
    with _adapters(lines, mosquitto.port) as adapters:
        path = run.directory / "config.yaml"
        path.write_text(_configuration(adapters))
        with Daemon(path, "--log-level=error") as daemon, ThreadPoolExecutor(lines) as pool:
            list(pool.map(_Adapter.unplug_and_plug, adapters, [0] * lines))
            before = _open_descriptors(daemon)
            turns = list(pool.map(_Adapter.unplug_and_plug, adapters, [each] * lines))
            grown = _open_descriptors(daemon) - before
        modules = [adapter.line.module(1) for adapter in adapters]
    mosquitto.stop()
    switched = sum(module.ordered.total() for module in modules)
    kept = all(module.outputs == 1 << (BY_HAND - 1) for module in modules)
    gone, back = (max(pair[which] for turn in turns for pair in turn) for which in (0, 1))
    return Figure(
        injected=f"{lines * each} unplugs of {lines} adapters",
        seen=f"gone within {gone:.1f} s, back within {back:.1f} s, {grown:+d} descriptors, "
        f"{switched} relays switched",
        promised="gone and back within 5 s, +0 descriptors, 0 relays",
        kept=max(gone, back) <= WITHIN_S and grown == 0 and switched == 0 and kept,
    )


# --- C4 ---------------------------------------------------------------------------------------

HOLES: tuple[tuple[Way, ...], ...] = ((Way.IN, Way.OUT), (Way.IN,), (Way.OUT,))
NOTICED_S = 30.0


def _until_noticed(port: int, name: str, ways: tuple[Way, ...], ping_s: float) -> float:
    """Stalls a link on which pings go out; tells when the client says that it is gone."""
    events = EventLog()
    ping = OutMessage(f"b/{name}/ping", b"", qos=0, retain=False)
    with TcpRelay(port) as relay:
        config = MqttConfig("127.0.0.1", relay.port, "b", name, "auto")
        client = MqttClient(config, [Subscription(ping.topic)], events, None)
        client.start()
        events.wait(Connected)
        relay.stall(*ways)
        began = time.monotonic()
        while not events.of(Disconnected) and time.monotonic() < began + 2 * NOTICED_S:
            client.publish(ping)
            time.sleep(ping_s)  # the bridge pings once a second
        client.stop(0.5)
        ends = events.of(Disconnected)
    return ends[0].at - began if ends else float("inf")


@proof("C4")
def black_holes_are_noticed(run: Run) -> Figure:
    """A link that passes nothing on, both ways or one, does not stay `connected`."""
    keepalive_s = run.scale.of(1, wire._KEEPALIVE_S)
    hurry = wire._KEEPALIVE_S / keepalive_s  # the short proof takes all times shorter
    within_s = NOTICED_S / hurry + run.scale.of(1, 0)  # a hurried machine gets some slack
    rounds = run.scale.of(1, 4)
    holes = [(f"c{n}", hole) for n, hole in enumerate(HOLES * rounds)]
    mosquitto = Mosquitto(run.directory / "mosquitto")
    mosquitto.start()
    with (
        patch.object(wire, "_KEEPALIVE_S", keepalive_s),
        ThreadPoolExecutor(len(holes)) as pool,
    ):
        waits = [
            pool.submit(_until_noticed, mosquitto.port, name, ways, 1.0 / hurry)
            for name, ways in holes
        ]
        took_s = [wait.result() for wait in waits]
    mosquitto.stop()
    return Figure(
        injected=f"{len(holes)} links stalled: both ways, and each way alone",
        seen=f"noticed within {max(took_s):.1f} s",
        promised=f"noticed within {within_s:.0f} s",
        kept=max(took_s) <= within_s,
    )
