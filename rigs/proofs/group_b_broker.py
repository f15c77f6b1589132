"""Brokers that come, go and stay away, and clients that fight over one id: B2, B4, B5, B6."""

import json
import logging
import time
import tracemalloc
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

from support.daemon import Daemon
from support.event_log import EventLog
from support.fake_worker import FakeWorker
from support.mosquitto import Mosquitto, free_port
from support.mqtt_probe import MqttProbe, Seen
from support.mqtt_side import FakeConnection
from support.panel import BASE, is_complete, panel, results, write_config

from bridge.clock import boot_s
from bridge.config.load import load_config
from bridge.config.schema import MqttConfig
from bridge.daemon.wiring import Outside, build_tree
from bridge.model import LineProtocol, ValuesChanged
from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import Acknowledged, Connected, OutMessage, Subscription
from bridge.mqtt.reconnect import Backoff, Ending, ReconnectPlan
from bridge.simulator.line import SimulatedLine
from proofs import impatient_bridge
from proofs.figures import Figure, Run, Scale, proof

# --- B2 ---------------------------------------------------------------------------------------

WORKS_WITHIN_S = 5.0
HOUSES = 2
TRIES = 2
LAST_CHARS = 3000


def _restarts(directory: Path, count: int) -> list[float]:
    """Restarts a broker that often; tells after which time from `online` a command was done."""
    mosquitto = Mosquitto(directory / "mosquitto")
    mosquitto.start()
    took_s = []
    with panel(LineProtocol.MODBUS_RTU) as line:
        config = write_config(directory, line, mosquitto.port, discovery="off")
        with Daemon(config, program=(impatient_bridge.__file__,)) as daemon:
            daemon.wait_for_log("online: DIO100")
            for n in range(count):
                if n % 2:
                    mosquitto.kill()
                mosquitto.restart()
                took_s.append(_until_done(mosquitto.port, n))
                if took_s[-1] > WORKS_WITHIN_S:
                    print(f"the daemon's log: {daemon.log[-LAST_CHARS:]}")
    mosquitto.stop()
    return took_s


def _until_done(port: int, number: int) -> float:
    """From the bridge's `online` to a verdict `done`, as seconds; inf: there was none in time."""
    with MqttProbe(port, f"{BASE}/bridge/state", f"{BASE}/garage/result") as probe:
        probe.wait_message(f"{BASE}/bridge/state", "online")
        connected = time.monotonic()
        # On a busy machine a simulated module may be late once, which is no matter of the broker.
        for attempt in range(TRIES):
            command_id = f"{number} {attempt}"
            wish = {"state": "OFF" if number % 2 else "ON", "id": command_id}
            probe.publish(f"{BASE}/garage/do/1/set", json.dumps(wish))
            with suppress(AssertionError):
                probe.wait_for(partial(_is_done, command_id=command_id), WORKS_WITHIN_S / TRIES)
                return time.monotonic() - connected
        print(f"restart {number}: no command done; seen: {probe.seen}")
    return float("inf")


def _is_done(seen: list[Seen], command_id: str) -> bool:
    # The verdict before may come again: the broker died before it acknowledged it.
    return any(each["status"] == "done" and each["id"] == command_id for each in results(seen))


@proof("B2")
def subscriptions_outlive_brokers(run: Run) -> Figure:
    """After each restart of the broker a command is carried out."""
    count = run.scale.of(3, 250)
    with ThreadPoolExecutor() as pool:
        directories = [run.directory / str(n) for n in range(HOUSES)]
        for directory in directories:
            directory.mkdir()
        took_s = [t for each in pool.map(_restarts, directories, [count] * HOUSES) for t in each]
    late = sum(t > WORKS_WITHIN_S for t in took_s)
    return Figure(
        injected=f"{len(took_s)} restarts of the broker, half of them kills",
        seen=f"{len(took_s) - late} commands done, the slowest after {max(took_s):.2f} s",
        promised=f"all done within {WORKS_WITHIN_S:.0f} s of connecting",
        kept=late == 0,
    )


# --- B4 ---------------------------------------------------------------------------------------

# A minute of the short proof takes a second.
HASTY = Backoff(first_s=0.02, longest_s=0.2, lasting_s=0.5, taken_over_s=1.0)


class _Causes(logging.Handler):
    """Notes when the log says that another client uses our id.

    Attributes:
        at: The instants.
    """

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.at: list[float] = []

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        if "another client seems to use the client id" in record.getMessage():
            self.at.append(time.monotonic())


@contextmanager
def _clients(
    port: int, names: Sequence[str], backoff: Backoff, protocol: str = "auto"
) -> Iterator[list[EventLog]]:
    """Started clients, one for each name, and what they emit."""
    with ExitStack() as stack:
        logs = []
        for name in names:
            config = MqttConfig("127.0.0.1", port, "b", name, protocol)
            logs.append(EventLog())
            client = MqttClient(config, [Subscription("b/+/set")], logs[-1], None, backoff=backoff)
            client.start()
            stack.callback(client.stop, 5)
        yield logs


def _most_in_a_minute(instants: Sequence[float], minute_s: float) -> int:
    return max((sum(at <= t < at + minute_s for t in instants) for at in instants), default=0)


def _fight(port: int, protocol: str, scale: Scale) -> tuple[int, int, bool]:
    """Two clients with one id; returns the most flips in a minute, all flips, and the cause."""
    backoff = Backoff() if scale is Scale.FULL else HASTY
    causes = _Causes()
    logger = logging.getLogger("bridge.mqtt.client")
    logger.addHandler(causes)
    with _clients(port, ["twin" + protocol] * 2, backoff, protocol) as logs:
        time.sleep(scale.of(3, 300))  # the fight itself
    logger.removeHandler(causes)
    connects = sorted(event.at for log in logs for event in log.of(Connected))
    since = causes.at[0] if causes.at else 0.0
    flips = [at for at in connects if at > since]
    return _most_in_a_minute(flips, backoff.taken_over_s), len(flips), bool(causes.at)


@proof("B4")
def two_clients_with_one_id_make_peace(run: Run) -> Figure:
    """They throw each other out ever so rarely, and the log says why."""
    mosquitto = Mosquitto(run.directory / "mosquitto")
    mosquitto.start()
    with ThreadPoolExecutor() as pool:
        fights = pool.map(_fight, [mosquitto.port] * 2, ["5", "3.1.1"], [run.scale] * 2)
        (most_5, flips_5, told_5), (most_311, flips_311, told_311) = fights
    mosquitto.stop()
    minutes = run.scale.of(3, 5)
    return Figure(
        injected=f"two clients with one id for {minutes} backed-off minutes, on MQTT 5 and 3.1.1",
        seen=f"at most {most_5} and {most_311} flips a minute ({flips_5} and {flips_311}), cause "
        f"{'' if told_5 and told_311 else 'not '}logged",
        promised="at most 2 flips a minute once it is recognised, cause logged",
        kept=max(most_5, most_311) <= 2 and min(flips_5, flips_311) > 0 and told_5 and told_311,
    )


# --- B5 ---------------------------------------------------------------------------------------

CONNECTED_WITHIN_S = 12.0
OUTAGE_S = 600.0


def _longest_pause_s(outages: int) -> float:
    """The longest time without an attempt in so many planned outages."""
    longest_s = 0.0
    for _ in range(outages):
        plan, passed_s = ReconnectPlan("auto", Backoff()), 0.0
        while passed_s < OUTAGE_S:
            pause_s = plan.pause_after(Ending.UNREACHABLE, 0.0)
            longest_s = max(longest_s, pause_s)
            passed_s += pause_s
    return longest_s


@proof("B5")
def a_late_broker_is_found(run: Run) -> Figure:
    """Clients that waited in vain are connected soon after the broker came."""
    outage_s, clients = run.scale.of(1, 90), run.scale.of(4, 20)
    longest_s = _longest_pause_s(run.scale.of(10, 1000))
    mosquitto = Mosquitto(run.directory / "mosquitto")
    with _clients(mosquitto.port, [f"c{n}" for n in range(clients)], Backoff()) as logs:
        time.sleep(outage_s)  # the outage itself
        mosquitto.start()
        began = time.monotonic()
        slowest_s = max(log.wait(Connected).at for log in logs) - began
        mosquitto.stop()
    return Figure(
        injected=f"broker absent for {outage_s} s ({clients} clients); 10 min (planned)",
        seen=f"connected within {slowest_s:.1f} s; pauses of at most {longest_s:.1f} s",
        promised=f"connected within {CONNECTED_WITHIN_S:.0f} s",
        kept=slowest_s <= CONNECTED_WITHIN_S and longest_s + 1.0 <= CONNECTED_WITHIN_S,
    )


# --- B6 ---------------------------------------------------------------------------------------

MOST_GROWTH = 1 << 20
WARM_UP = 300


def _planned_outage(path: Path, changes: int) -> tuple[int, Counter[str], bool]:
    """Through hub, publisher, outbox and session; returns growth, sent states, all the newest."""
    client = FakeConnection(up=False)
    config = load_config(path, {"HOME": "/nowhere"})
    tree = build_tree(config, Outside(client, boot_s), FakeWorker, lambda _told: None)

    def change(number: int) -> None:
        tree.hub.apply(ValuesChanged("garage", number * 40_503 & 0xFFFF, number & 0xFF))
        tree.broker.session.tick(float(number))

    for number in range(WARM_UP):
        change(number)
    tracemalloc.start()
    for number in range(WARM_UP, changes):
        change(number)
    growth = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    client.up = True
    tree.broker.session.handle(Connected("5", float(changes)), float(changes))
    tree.broker.session.tick(float(changes))
    while client.unacknowledged:
        tree.broker.session.handle(Acknowledged(client.unacknowledged.pop(0)), float(changes))
        tree.broker.session.tick(float(changes))
    last = changes - 1
    states = [m for m in client.sent if m.topic.startswith(f"{BASE}/garage/d")]
    newest = all(m.payload == _state(m, last * 40_503 & 0xFFFF, last & 0xFF) for m in states)
    return growth, Counter(message.topic for message in states), newest


def _state(message: OutMessage, inputs: int, outputs: int) -> bytes:
    _, _, direction, channel = message.topic.split("/")
    bits = inputs if direction == "di" else outputs
    return b"ON" if bits >> (int(channel) - 1) & 1 else b"OFF"


def _memory(process: int) -> int:
    """What a process holds of the machine's memory, in bytes."""
    pages = Path(f"/proc/{process}/statm").read_text().split()[1]
    return int(pages) * 4096


def _toggle_for(line: SimulatedLine, seconds: float) -> None:
    until, number = time.monotonic() + seconds, 0
    while time.monotonic() < until:
        number += 1
        line.module(1).toggle_input(number % 16 + 1)
        time.sleep(0.01)  # the pace of the world


def _is_back(seen: list[Seen]) -> bool:
    return is_complete([message for message in seen if message.topic.startswith(BASE)])


def _real_outage(directory: Path, seconds: float) -> tuple[int, Counter[str], bool]:
    """The daemon itself; returns growth, what each state topic got, and whether it is true."""
    mosquitto = Mosquitto(directory / "mosquitto")
    with panel(LineProtocol.MODBUS_RTU) as line:
        config = write_config(directory, line, mosquitto.port)
        with Daemon(config, program=(impatient_bridge.__file__,)) as daemon:
            daemon.wait_for_log("online: DO100")
            _toggle_for(line, 1.0)
            before = _memory(daemon.process.pid)
            _toggle_for(line, seconds)
            growth = _memory(daemon.process.pid) - before
            time.sleep(0.5)  # the last change is read
            mosquitto.start()
            with MqttProbe(mosquitto.port, f"{BASE}/#") as probe:
                probe.wait_for(_is_back)
                seen = [m for m in probe.seen if m.topic.startswith(f"{BASE}/garage/di/")]
            inputs = line.module(1).inputs
    mosquitto.stop()
    true = all(
        m.text == ("ON" if inputs >> (int(m.topic.rpartition("/")[2]) - 1) & 1 else "OFF")
        for m in seen
    )
    return growth, Counter(message.topic for message in seen), true


@proof("B6")
def an_outage_costs_no_memory(run: Run) -> Figure:
    """States change all the time while the broker is away: only the newest are kept."""
    changes, seconds = run.scale.of(1_500, 200_000), run.scale.of(2, 60)
    with panel(LineProtocol.MODBUS_RTU) as line:
        path = write_config(run.directory, line, free_port())
    planned, sent, newest = _planned_outage(path, changes)
    real, seen, true = _real_outage(run.directory, seconds)
    once = set(sent.values()) == {1} == set(seen.values()) and (len(sent), len(seen)) == (24, 16)
    return Figure(
        injected=f"{changes} changes without a broker; {seconds} s of changes in the daemon",
        seen=f"growth {planned >> 10} KiB; {real >> 10} KiB; each topic "
        f"{'once' if once else 'not once'}, {'newest' if newest and true else 'old'} value",
        promised="growth under 1 MiB, newest value once a topic",
        kept=max(planned, real) < MOST_GROWTH and once and newest and true,
    )
