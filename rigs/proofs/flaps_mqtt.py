"""What can come and go at the broker and the disk, made to, through the real objects."""

import itertools
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest import mock

from support.mqtt_side import CONFIG, FakeConnection

from bridge.config.current import CurrentConfig
from bridge.daemon.reload import Reload
from bridge.daemon.wiring import Outside, build_broker_side
from bridge.errors import ConfigError, Problem
from bridge.hub.count_keeper import CountKeeper
from bridge.hub.counts import Counts
from bridge.model import Reason, Status, Verdict
from bridge.mqtt.broker_limits import BrokerLimits
from bridge.mqtt.broker_memory import BrokerMemory
from bridge.mqtt.client import MqttClient
from bridge.mqtt.connection import Connection
from bridge.mqtt.events import Connected, Received, Subscription
from bridge.mqtt.reconnect import Ended, Ending
from bridge.mqtt.wire import guarded
from proofs.flapping import Flap

_WALL = datetime(2024, 5, 1, tzinfo=UTC)
_PING = "wisco/bridge/ping"


class _Side:
    """Session, intake, desk, publisher and announcer, at a broker that only remembers."""

    def __init__(self, flap: Flap) -> None:
        self.flap = flap
        self.broker = FakeConnection()
        outside = Outside(
            self.broker,
            flap.clock,
            lambda: _WALL,
            jitter_s=lambda: 0.0,
            budgets=flap.budgets,
        )
        side = build_broker_side(CurrentConfig(CONFIG), outside, lambda _: None, lambda _: None)
        self.outbox, self.publisher, self.desk = side.outbox, side.publisher, side.desk
        self.announcer, self.session = side.announcer, side.session

    def receive(self, topic: str, payload: bytes = b"?") -> None:
        """Have a message come, and forget what goes out about it."""
        now = self.flap.clock()
        self.session.handle(Received(topic, payload, False, now), now)
        self.outbox.disconnected(now + 61.0)  # verdicts are held for 60 s


def _nothing() -> None:
    """It has no end: it only repeats."""


def _client(flap: Flap) -> MqttClient:
    filters = [Subscription("wisco/+/set"), Subscription("wisco/+/do/+/set")]
    return MqttClient(CONFIG.mqtt, filters, lambda _: None, None, budgets=flap.budgets)


def _taken(denied: dict[str, str]) -> Connection:
    """Stand for a connection that the broker took."""
    return cast(
        "Connection", SimpleNamespace(denied=denied, subscribed_at=0.0, limits=BrokerLimits())
    )


def connection(flap: Flap) -> None:
    """The broker takes the connection and closes it; each other time it refuses."""
    client = _client(flap)
    endings = itertools.cycle(
        Ended(ending, "why")
        for ending in (Ending.LOST, Ending.UNREACHABLE, Ending.CREDENTIALS, Ending.TAKEN_OVER)
    )
    flap.alternate(
        lambda: client._announce(_taken({})), lambda: cast("None", client._after(next(endings), 0))
    )


def denials(flap: Flap) -> None:
    """The broker denies a subscription and publications, and grants them again."""
    client = _client(flap)
    counters, backlog = client.counters, client._backlog
    with mock.patch("bridge.mqtt.connection.os.eventfd"):
        one: Any = Connection(
            CONFIG.mqtt,
            protocol="5",
            subscriptions=[],
            plain=tuple,
            memory=BrokerMemory(),
            will=None,
            emit=lambda _: None,
            counters=counters,
            attempt_s=1.0,
            backlog=backlog,
            log=client._bounded,
        )

    def deny() -> None:
        client._tell_denied({"wisco/+/set": "Not authorized"}, "a:1")
        one._sending._named.clear()
        for topic in ("wisco/garage/di/1", "wisco/attic/di/1", "reply/here", "reply/there"):
            one._sending._refused(topic, "Not authorized")

    flap.alternate(deny, lambda: client._tell_denied({}, "a:1"))


def stale(flap: Flap) -> None:
    """Pings come back, or do not; looked at once a second."""
    side = _Side(flap)
    side.session.handle(Connected("5", 0.0), 0.0)
    answers = False

    def look() -> None:
        nonlocal answers
        now = flap.clock()
        answers = now % flap.period_s < flap.period_s / 2
        side.session.tick(now)
        side.broker.unacknowledged.clear()
        for message in side.broker.taken():
            if answers and message.topic == _PING:
                side.session.handle(Received(_PING, message.payload, False, now), now)

    while flap.clock() < flap.length_s:
        look()
        flap.pass_time(min(1.0, flap.period_s / 2))


def suspends(flap: Flap) -> None:
    """The machine is suspended again and again."""
    side = _Side(flap)
    flap.alternate(lambda: side.session.suspended(15.0, flap.clock()), _nothing)


def commands(flap: Flap) -> None:
    """Commands are refused, fail, and go to stations that there are not; requests are refused."""
    side = _Side(flap)
    numbers = itertools.count()

    def ask() -> None:
        side.receive("wisco/garage/do/1/set")
        side.receive(f"wisco/nobody{next(numbers)}/do/1/set")
        side.receive(f"wisco/bridge/request/fly{next(numbers)}")
        side.receive("wisco/bridge/request/known")
        failed = Verdict("garage", "do/1", "ON", Status.FAILED, 5, Reason.NO_REPLY)
        side.publisher.publish(failed)

    side.desk.serve("known", lambda _: {})
    flap.alternate(ask, _nothing)


def verdicts(flap: Flap) -> None:
    """Verdicts are dropped while the broker is away."""
    side = _Side(flap)

    def lose() -> None:
        side.outbox.dropped_verdicts += 7
        side.session._tell_dropped()

    flap.alternate(lose, _nothing)


def leftovers(flap: Flap) -> None:
    """Topics that are not configured any more are cleared, and are there again."""
    announcer = _Side(flap).announcer
    flap.alternate(lambda: announcer._tell(["wisco/old/availability"]), _nothing)


def messages(flap: Flap) -> None:
    """Topics that are no text, and a callback that fails."""
    client = _client(flap)

    def fail() -> None:
        raise ValueError("a fault of ours")

    undecodable: Any = mock.Mock(spec=Connection)
    undecodable._counters, undecodable._log = client.counters, client._bounded

    def receive() -> None:
        Connection.arrived(undecodable, None, 0)
        guarded(fail, client._bounded)()

    flap.alternate(receive, _nothing)


def reloads(flap: Flap) -> None:
    """A file with many problems is read again, then the one that is in force."""
    problems = [Problem("config.yaml", n, 1, "no such key") for n in range(30)]
    side = _Side(flap)
    bad = False

    def load() -> Any:
        if bad:
            raise ConfigError(problems)
        return CONFIG

    anything: Any = SimpleNamespace(
        workers={}, ready=lambda _: None, reloading=_nothing, exchange=_nothing
    )
    reload = Reload(
        current=CurrentConfig(CONFIG),
        load=load,
        lines=anything,
        hub=anything,
        session=side.session,
        desk=side.desk,
        notifier=anything,
        clock=flap.clock,
        budgets=flap.budgets,
    )

    def again(*, worse: bool) -> None:
        nonlocal bad
        bad = worse
        reload.ask()
        reload.tick(_nothing)

    flap.alternate(lambda: again(worse=True), lambda: again(worse=False))


def disk(flap: Flap) -> None:
    """Counts cannot be written, and can be again."""
    current = CurrentConfig(CONFIG)
    keeper = CountKeeper(current, Counts(current, lambda *_: None), budgets=flap.budgets)
    path = Path("/nowhere/counts.json")

    full = True

    def write() -> None:
        if full:
            raise OSError("no space left")

    def again(*, fails: bool) -> None:
        nonlocal full
        full = fails
        keeper._writer._work(path, write, lambda: None)

    flap.alternate(lambda: again(fails=True), lambda: again(fails=False))
