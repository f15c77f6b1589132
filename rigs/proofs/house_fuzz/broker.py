"""A broker in memory with one client, the bridge: it is slow, mute, forgetful or away on demand."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from bridge.config.schema import MqttConfig
from bridge.mqtt.events import (
    Acknowledged,
    Connected,
    Disconnected,
    MqttEvent,
    OutMessage,
    Received,
    Subscribed,
    Subscription,
)
from proofs.house_fuzz.clockwork import Clockwork

BASE = "wisco"
PING = f"{BASE}/bridge/ping"
STATE = f"{BASE}/bridge/state"
STATUS = "homeassistant/status"
SETTLED_S, STALE_S = 0.5, 3.0
NOTICED_S = 0.15  # so soon after it a suspend is noticed


class Watcher(Protocol):
    """Records the messages that pass the broker."""

    def told(self, topic: str, payload: bytes, retain: bool) -> None:
        """The bridge published this, and the broker has it."""
        ...

    def arrived(self, received: Received, published_at: float, *, live: bool) -> None:
        """The bridge was handed this message."""
        ...

    def connection(self, *, up: bool) -> None:
        """A connection began or ended."""
        ...

    def looked(self) -> None:
        """A ping of the bridge comes back just now."""
        ...

    def came_back(self) -> None:
        """A ping of the bridge came back in time."""
        ...


@dataclass
class Link:
    """One connection. `fresh_at`: when the newest ping that came back was sent."""

    client: "Client"
    up: bool = True
    out_due: float = 0.0  # nothing arrives before this: order is kept
    in_due: float = 0.0
    unacknowledged: int = 0
    settled_at: float | None = None
    fresh_at: float = 0.0
    proven_from: float = 0.0  # a ping that was sent before this proves nothing


class Broker:
    """Keeps what is retained, and passes on what the bridge listens to."""

    def __init__(self, clockwork: Clockwork, chance: random.Random) -> None:
        self.watcher: Watcher
        self.clockwork = clockwork
        self.retained: dict[str, bytes] = {}
        self.stored: dict[str, bytes] = {}  # commands that somebody published with retain
        self.listens = True
        self.mute = False
        self.forgetful = False
        self.protocol = "5"
        self.latency_s = 0.002
        self.stalled_until = 0.0
        self.link: Link | None = None
        self.lost_verdicts: list[tuple[str, bytes]] = []  # not acknowledged: they may come twice
        self._on_way: list[tuple[str, bytes]] = []
        self._chance = chance

    # --- troubles -----------------------------------------------------------------------------

    def cut(self) -> None:
        """Drop the connection: what is on its way is lost, and the will is told."""
        self.watcher.looked()  # it may have been away for a while before
        link, self.link = self.link, None
        if link is None or not link.up:
            return
        link.up = False
        self.lost_verdicts += self._on_way
        self._on_way.clear()
        self.retained[STATE] = b"offline"
        self.watcher.connection(up=False)
        link.client.dropped(link)

    def slept(self, seconds: float) -> None:
        """The machine was suspended: what is connected is to be proven anew."""
        if self.link is not None:
            if seconds > STALE_S:  # else what arrives is young whatever is known of the link
                self.link.settled_at = None
            self.link.proven_from = self.clockwork.now

    def proven(self, now: float) -> bool:
        """Tell whether what arrives now may switch something."""
        link = self.link
        if link is None or link.settled_at is None or now < link.settled_at:
            return False
        return now - link.fresh_at <= STALE_S

    def away(self, now: float) -> bool:
        """Tell whether no ping of this connection came back for so long."""
        link = self.link
        return link is None or link.settled_at is None or now - link.fresh_at > STALE_S

    # --- the bridge ---------------------------------------------------------------------------

    def accept(self, client: "Client") -> Link:
        """Take a connection and its subscriptions."""
        link = self.link = Link(client)
        self.watcher.connection(up=True)
        if self.protocol != "5" or self.forgetful:
            for topic, payload in self.stored.items():
                self._hand(link, topic, payload, retain=not self.forgetful, live=False)
        return link

    def take(self, link: Link, token: int, message: OutMessage) -> None:
        """Take in what the bridge published, a while later."""
        if message.topic.endswith("/result"):
            self._on_way.append((message.topic, message.payload))
        link.unacknowledged += message.qos > 0
        sent_at = self.clockwork.now
        link.out_due = self._due(link.out_due)

        def arrive() -> None:
            if link.up:
                self._taken(link, token, message, sent_at)

        self.clockwork.after(link.out_due - self.clockwork.awake_s, arrive)

    def _taken(self, link: Link, token: int, message: OutMessage, sent_at: float) -> None:
        topic, payload = message.topic, message.payload
        if message.retain:
            if payload:
                self.retained[topic] = payload
            else:
                self.retained.pop(topic, None)
        self.watcher.told(topic, payload, message.retain)
        if message.qos:
            self._later(link, lambda: self._acknowledge(link, token, message))
        if self.mute:
            return
        if topic == PING:
            self._later(link, lambda: self._ping_back(link, payload, sent_at))
        elif topic in {STATE, STATUS} or topic.endswith("/set"):
            self._hand(link, topic, payload, retain=False, live=False)

    def _acknowledge(self, link: Link, token: int, message: OutMessage) -> None:
        link.unacknowledged -= 1
        if message.topic.endswith("/result") and (message.topic, message.payload) in self._on_way:
            self._on_way.remove((message.topic, message.payload))
        link.client.emit(Acknowledged(token))

    def _ping_back(self, link: Link, payload: bytes, sent_at: float) -> None:
        now = self.clockwork.now
        self.watcher.looked()
        if link.settled_at is None and sent_at >= link.proven_from:
            link.settled_at = now + SETTLED_S
        link.fresh_at = max(link.fresh_at, sent_at)
        link.client.emit(Received(PING, payload, retain=False, at=now))
        if sent_at >= link.proven_from + NOTICED_S and not self.away(now):
            self.watcher.came_back()

    def survey(self, link: Link, subscriptions: Sequence[Subscription]) -> None:
        """Answer a look at what is retained."""
        filters = [one.topic_filter.split("/") for one in subscriptions]
        found = [topic for topic in self.retained if any(matches(topic, one) for one in filters)]
        self._later(link, lambda: link.client.emit(Subscribed(())))
        for topic in found:
            self._hand(link, topic, self.retained[topic], retain=True, live=False)

    # --- everybody else -----------------------------------------------------------------------

    def publish(self, topic: str, payload: bytes, *, retain: bool = False, **extra: Any) -> None:
        """Publish a message. For a bridge that is away only retained messages are kept."""
        if retain:
            self.stored[topic] = payload
        if self.link is not None and self.link.up and not self.mute:
            flag = retain and self.protocol == "5"
            self._hand(self.link, topic, payload, retain=flag, live=True, **extra)

    def _hand(
        self, link: Link, topic: str, payload: bytes, *, retain: bool, live: bool, **extra: Any
    ) -> None:
        published_at = self.clockwork.now

        def arrive() -> None:
            received = Received(topic, payload, retain, self.clockwork.now, **extra)
            self.watcher.arrived(received, published_at, live=live)
            link.client.emit(received)

        self._later(link, arrive)

    def _later(self, link: Link, action: Callable[[], None]) -> None:
        link.in_due = self._due(link.in_due)
        delay_s = link.in_due - self.clockwork.awake_s
        self.clockwork.after(delay_s, lambda: action() if link.up else None)

    def _due(self, last: float) -> float:
        awake = self.clockwork.awake_s
        return max(
            last, awake + self.latency_s * self._chance.uniform(0.5, 1.5), self.stalled_until
        )


class Client:
    """Stands in for `bridge.mqtt.client.MqttClient`."""

    failure: str | None = None
    trouble: str | None = None
    rejected = False

    def __init__(
        self,
        broker: Broker,
        _config: MqttConfig,
        _subscriptions: Sequence[Subscription],
        emit: Callable[[MqttEvent], None],
        _will: OutMessage | None,
    ) -> None:
        self.emit = emit
        self._broker = broker
        self._clockwork = broker.clockwork
        self._link: Link | None = None
        self._stopped = False
        self._token = 0

    @property
    def progress(self) -> float:
        """It is always well."""
        return self._clockwork.now

    @property
    def connected(self) -> bool:
        """Tell whether there is a connection."""
        return self._link is not None

    def alive(self) -> bool:
        """It never dies."""
        return True

    def start(self) -> None:
        """Connect as soon as it can."""
        self._clockwork.after(0.01, self._try)

    def _try(self) -> None:
        if self._stopped or self._link is not None:
            return
        if not self._broker.listens:
            self._clockwork.after(0.7, self._try)
            return
        link = self._broker.accept(self)
        at = self._clockwork.now
        self._link = link
        self.emit(Connected(self._broker.protocol, at))

    def dropped(self, link: Link) -> None:
        """The connection is gone."""
        if self._link is link:
            self._link = None
            self.emit(Disconnected("cut", self._clockwork.now))
            self._clockwork.after(0.5, self._try)

    def publish(self, message: OutMessage) -> int | None:
        """Hand over a message."""
        if self._link is None:
            return None
        self._token += 1
        self._broker.take(self._link, self._token, message)
        return self._token

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """Look at what is retained."""
        if self._link is not None:
            self._broker.survey(self._link, subscriptions)

    def leave_mute(self) -> None:
        """Stay: there is one server."""

    def connect_anew(self, why: str) -> None:
        """Fail: this broker loses no acknowledgement."""
        raise AssertionError(why)

    def unsubscribe(self, _filters: Sequence[str]) -> None:
        """It was only a look."""

    def stop(self, timeout_s: float) -> None:
        """Let what was published arrive, and say goodbye."""
        self._stopped = True
        until = self._clockwork.now + timeout_s
        while self._link is not None and self._link.unacknowledged and self._clockwork.now < until:
            self._clockwork.wait(0.02)
        link, self._link = self._link, None
        if link is not None:
            link.up = False
            self._broker.link = None
            self._broker.watcher.connection(up=False)


def matches(topic: str, topic_filter: Sequence[str]) -> bool:
    """Tell whether a topic matches a filter that was split."""
    levels = topic.split("/")
    for at, level in enumerate(topic_filter):
        if level == "#":
            return True
        if at >= len(levels) or level not in {"+", levels[at]}:
            return False
    return len(levels) == len(topic_filter)
