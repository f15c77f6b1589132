"""A session on a virtual clock, and a broker that is some way off."""

from collections import deque
from collections.abc import Callable, Sequence
from datetime import UTC, datetime

from bridge.config.current import CurrentConfig
from bridge.config.schema import Config
from bridge.daemon.wiring import Outside, build_broker_side
from bridge.mqtt.events import (
    Acknowledged,
    Connected,
    OutMessage,
    Received,
    Subscribed,
    Subscription,
)

_STARTED = datetime(2024, 5, 1, 12, tzinfo=UTC)


class FarBroker:
    """Takes what the session sends `way_s` later; as long does each of its answers take.

    Attributes:
        now: The virtual clock.
        publisher: Where the hub would tell its states and verdicts.
    """

    def __init__(
        self, config: Config, way_s: float, arrived: Callable[[OutMessage, float, float], None]
    ) -> None:
        """Args: `arrived` is told each message, when it was sent, and when it arrived."""
        self.now = 0.0
        self._way_s = way_s
        self._arrived = arrived
        self._token = 0
        self._out: deque[tuple[float, int, OutMessage]] = deque()
        self._back: deque[tuple[float, int, OutMessage]] = deque()
        self._status_topic = config.homeassistant.status_topic
        side = build_broker_side(
            CurrentConfig(config),
            Outside(self, lambda: self.now, lambda: _STARTED, jitter_s=lambda: 0.0),
            lambda _command: None,
            lambda _counts: None,
        )
        self._ping, self.publisher, self._session = side.topics.ping, side.publisher, side.session

    def connect(self) -> None:
        """The broker took the bridge, and retains nothing of it."""
        self._session.handle(Connected("5", self.now), self.now)
        self._session.handle(Subscribed(()), self.now)

    def birth(self) -> None:
        """Home Assistant says that it was started."""
        message = Received(self._status_topic, b"online", retain=False, at=self.now)
        self._session.handle(message, self.now)

    def step(self, seconds: float) -> None:
        """Lets time pass, and the session do what is due."""
        self.now += seconds
        while self._out and self._out[0][0] <= self.now - self._way_s:
            sent_at, token, message = self._out.popleft()
            self._arrived(message, sent_at, self.now)
            self._back.append((self.now, token, message))
        while self._back and self._back[0][0] <= self.now - self._way_s:
            _, token, message = self._back.popleft()
            if message.topic == self._ping:
                ping = Received(message.topic, message.payload, retain=False, at=self.now)
                self._session.handle(ping, self.now)
            elif message.qos > 0:
                self._session.handle(Acknowledged(token), self.now)
        self._session.tick(self.now)

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """See `MqttClient`: it retains nothing."""

    def unsubscribe(self, topic_filters: Sequence[str]) -> None:
        """See `MqttClient`."""

    def leave_mute(self) -> None:
        """See `MqttClient`: there is no other."""

    def connect_anew(self, why: str) -> None:
        """See `MqttClient`: this connection is good."""
        raise AssertionError(why)

    def publish(self, message: OutMessage) -> int:
        """See `MqttClient`: it is on its way."""
        self._token += 1
        self._out.append((self.now, self._token, message))
        return self._token
