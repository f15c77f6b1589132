"""A15: a client that floods the broker switches relays."""

import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe
from support.panel import BASE, STATIONS, is_complete, panel, write_config
from support.sent_commands import SentCommands

from bridge.model import DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from proofs.figures import Figure, Run, Scale, proof

RATE_LIMIT = 20  # commands a second, where the configuration says nothing else
SERVED_WITHIN_S = 2.0
GUSTS = 10
PATIENCE_S = 30.0
# The broker hands on everything, however far behind the bridge is.
UNBOUNDED = ("max_queued_messages 0", "max_inflight_messages 0")
OTHERS = [("pumps", n) for n in range(1, DO100.outputs + 1)]


@dataclass(frozen=True, slots=True)
class _Flooded:
    """The result of one flood.

    Attributes:
        unanswered: Commands of the flood without a verdict.
        orders: The number of its switchings.
        excess: How many of these were beyond the limit.
        others: Commands for another station meanwhile.
        waited_s: How long each of those that were carried out had waited.
    """

    unanswered: int
    orders: int
    excess: float
    others: int
    waited_s: list[float]


def _flood(port: int, commands: int) -> None:
    """Sends commands for one output, evenly over a second."""
    arguments = ["mosquitto_pub", "-p", str(port), "-t", f"{BASE}/garage/do/1/set", "-l"]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, text=True) as flooder:
        pipe = flooder.stdin
        assert pipe is not None
        for _ in range(GUSTS):
            pipe.write("TOGGLE\n" * (commands // GUSTS))
            pipe.flush()
            time.sleep(1 / GUSTS)


def _command_others(port: int, others: SentCommands, times: int) -> None:
    """Commands another station, five times a second."""
    with MqttProbe(port, f"{BASE}/nothing") as sender:
        for _ in range(times):
            others.publish(sender)
            time.sleep(0.2)


def _commands(scale: Scale) -> int:
    return scale.of(2000, 10_000)


def _serve(directory: Path, line: SimulatedLine, scale: Scale, others: SentCommands) -> int:
    """Runs the bridge through a flood; returns how many commands of it got no verdict."""
    commands = _commands(scale)
    mosquitto = Mosquitto(directory / "mosquitto", options=UNBOUNDED)
    mosquitto.start()
    try:
        with Daemon(write_config(directory, line, mosquitto.port)):
            with MqttProbe(mosquitto.port, f"{BASE}/#") as probe:
                probe.wait_for(is_complete)
            with MqttProbe(mosquitto.port, f"{BASE}/+/result") as probe:
                flood = threading.Thread(target=_flood, args=(mosquitto.port, commands))
                flood.start()
                _command_others(mosquitto.port, others, scale.of(8, 15))
                flood.join()
                due = commands + len(others.sent)
                probe.wait_for(lambda seen: len(seen) >= due, PATIENCE_S)
                answered = sum(m.topic == f"{BASE}/garage/result" for m in probe.seen)
                return commands - answered
    finally:
        mosquitto.stop()


def _flooded(run: Run, *, paced: bool) -> _Flooded:
    """`paced`: at 9600 baud, where the line is what is short; else only the limit holds."""
    others = SentCommands(OTHERS)
    directory = run.directory / ("slow" if paced else "fast")
    directory.mkdir()
    with panel(LineProtocol.MODBUS_RTU, paced=paced) as line:
        unanswered = _serve(directory, line, run.scale, others)
        orders = list(line.module(STATIONS["garage"][0]).switchings)
        served = [("pumps", order) for order in line.module(STATIONS["pumps"][0]).switchings]
    lasted_s = orders[-1].at - orders[0].at
    return _Flooded(
        unanswered=unanswered,
        orders=len(orders),
        excess=len(orders) - RATE_LIMIT * (1 + lasted_s),  # the bucket holds one second's worth
        others=len(others.sent),
        waited_s=others.waited_s(served),
    )


@proof("A15")
def a_flood_of_commands(run: Run) -> Figure:
    """One station is flooded: it is switched no faster than its limit, the others are served."""
    floods = [_flooded(run, paced=paced) for paced in (True, False)]
    slowest_s = max(wait_s for flood in floods for wait_s in flood.waited_s)
    others = sum(flood.others for flood in floods)
    served = sum(len(flood.waited_s) for flood in floods)
    return Figure(
        injected=f"{_commands(run.scale)} commands in 1 s, on a slow line and on a fast one",
        seen=f"{floods[0].orders} and {floods[1].orders} writes; {served} of {others} others"
        f" in {slowest_s:.1f} s",
        promised=f"{RATE_LIMIT} a second at most; others within {SERVED_WITHIN_S:.0f} s",
        kept=all(flood.excess <= 0 and flood.unanswered == 0 for flood in floods)
        and served == others
        and slowest_s <= SERVED_WITHIN_S,
    )
