"""Brokers that allow little: F17, F18."""

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

from support.daemon import Daemon
from support.event_log import EventLog
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, panel, retained_topics, write_config
from support.strict_broker import Allows, StrictBroker

from bridge.config.schema import MqttConfig
from bridge.model import LineProtocol
from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import Connected, Subscribed, Subscription
from bridge.mqtt.reconnect import Backoff
from bridge.mqtt.topics import Topics
from proofs import impatient_bridge
from proofs.figures import Figure, Run, Scale, proof

PROTOCOLS = ("5", "3.1.1")
JOBS = 3

# --- F17 --------------------------------------------------------------------------------------

FAST = Backoff(first_s=0.01, longest_s=0.02)
BESIDES = [Subscription(f"{BASE}/{n}/state", qos=0, live_only=False) for n in range(20)]


class _Accusations(logging.Handler):
    """Counts how often the log says that another client uses our id."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        self.count += "another client" in record.getMessage()


@contextmanager
def _accusations() -> Iterator[_Accusations]:
    handler = _Accusations()
    logger = logging.getLogger("bridge.mqtt.client")
    logger.addHandler(handler)
    try:
        yield handler
    finally:
        logger.removeHandler(handler)


def _is_ready(allowed: int, protocol: str) -> bool:
    """Return whether all subscriptions succeed, at the start and later."""
    events = EventLog()
    wanted = Topics(BASE).subscriptions("homeassistant/status")
    with StrictBroker(Allows(filters=allowed)) as broker:
        config = MqttConfig("127.0.0.1", broker.port, BASE, "b", protocol)
        client = MqttClient(config, wanted, events, None, backoff=FAST)
        client.start()
        try:
            events.wait(Connected)
            client.subscribe(BESIDES)
            denied = events.wait(Subscribed).denied
            filters = {one.topic_filter for one in (*wanted, *BESIDES)}
            return not denied and filters == set(broker.filters[-len(filters) :])
        except AssertionError:
            return False
        finally:
            client.stop(1)


@proof("F17")
def few_filters_a_packet_are_enough(run: Run) -> Figure:
    """A broker that closes the connection at more filters than it allows."""
    allowed = range(1, 101) if run.scale is Scale.FULL else (1, 8, 100)
    with _accusations() as accusations, ThreadPoolExecutor(JOBS) as pool:
        trials = list(product(allowed, PROTOCOLS))
        ready = sum(pool.map(lambda trial: _is_ready(*trial), trials))
    return Figure(
        injected=f"{len(trials)} brokers that take 1-100 filters a packet, on MQTT 5 and 3.1.1",
        seen=f"{ready} times ready, {accusations.count} times another client blamed",
        promised="always ready, never another client blamed",
        kept=ready == len(trials) and accusations.count == 0,
    )


# --- F18 --------------------------------------------------------------------------------------

# A broker of each kind that there is: how it says what it allows, or does not.
KINDS = ("max_packet_size", "message_size_limit", "says", "cuts")
LARGEST_BYTES = 20_000  # shorter than the announcement of a DIO100
MOST_LINES = 20


@dataclass(frozen=True, slots=True)
class _Trial:
    """One broker: its kind, its limit and the protocol."""

    kind: str
    limit: int
    protocol: str

    @property
    def is_mosquitto(self) -> bool:
        """Return whether it is a real mosquitto."""
        return self.kind in KINDS[:2]

    @property
    def leaves_out(self) -> bool:
        """Return whether an announcement is left out; one that mosquitto drops itself is sent."""
        drops = self.kind == "message_size_limit" and self.protocol == "3.1.1"
        return self.limit < LARGEST_BYTES and not drops


def _told(messages: dict[str, bytes], limit: int) -> bool:
    """Return whether `online` and every accepted state arrived."""
    online = (f"{BASE}/bridge/state", f"{BASE}/garage/availability", f"{BASE}/pumps/availability")
    may_miss = {f"{BASE}/bridge/info"} if limit < 2048 else set()
    there = retained_topics() - may_miss <= set(messages)
    return there and all(messages[topic] == b"online" for topic in online)


def _is_told(seen: list[Seen], limit: int) -> bool:
    return _told({message.topic: message.payload for message in seen}, limit)


@contextmanager
def _broker(trial: _Trial, directory: Path) -> Iterator[tuple[int, Callable[[], object]]]:
    """A broker; gives its port, and what waits until all is told there."""
    if trial.is_mosquitto:
        mosquitto = Mosquitto(directory / "mosquitto", options=[f"{trial.kind} {trial.limit}"])
        mosquitto.start()
        try:
            with MqttProbe(mosquitto.port, f"{BASE}/#") as probe:
                is_told = partial(_is_told, limit=trial.limit)
                yield mosquitto.port, lambda: probe.wait_for(is_told)
        finally:
            mosquitto.stop()
        return
    with StrictBroker(Allows(packet_bytes=trial.limit, says=trial.kind == "says")) as broker:
        yield broker.port, lambda: broker.wait_until(lambda: _told(broker.messages, trial.limit))


def _is_kept(trial: _Trial, directory: Path) -> bool:
    """Return whether a daemon starts at this broker and names what it left out in few lines."""
    directory.mkdir()
    with (
        panel(LineProtocol.MODBUS_RTU, paced=False) as line,
        _broker(trial, directory) as (port, wait),
    ):
        config = write_config(directory, line, port)
        protocol = f"port: {port}, protocol: '{trial.protocol}'"
        config.write_text(config.read_text().replace(f"port: {port}", protocol))
        with Daemon(config, program=(impatient_bridge.__file__,)) as daemon:
            try:
                wait()
                if trial.leaves_out:
                    daemon.wait_for_log("left out")
            except AssertionError as error:
                print(trial, str(error)[:2000], daemon.log[-3000:])
                return False
            lines = [one for one in daemon.log.splitlines() if "WARNING" in one]
            named = any("left out" in one and "homeassistant/device" in one for one in lines)
            quiet = len(lines) <= MOST_LINES and "another client" not in daemon.log
            return quiet and (named or not trial.leaves_out)


@proof("F18")
def no_limit_for_packets_keeps_the_bridge_away(run: Run) -> Figure:
    """Brokers that take packets of a few kilobytes, and say so, or drop more, or just close."""
    if run.scale is Scale.FULL:
        limits = [1 << n for n in range(10, 17)]
        trials = [_Trial(*each) for each in product(KINDS, limits, PROTOCOLS)]
    else:
        trials = [_Trial("cuts", 4096, "3.1.1")]
    directories = [run.directory / str(n) for n in range(len(trials))]
    with ThreadPoolExecutor(JOBS) as pool:
        kept = sum(pool.map(_is_kept, trials, directories))
    return Figure(
        injected=f"{len(trials)} brokers with limits of 1-64 kB: mosquitto's two, one that says "
        "its limit, one that closes; MQTT 5 and 3.1.1",
        seen=f"{kept} times `online` with all states, and what is left out named",
        promised="`online`, states there",
        kept=kept == len(trials),
    )
