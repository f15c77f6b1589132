"""What passes between the MQTT client and the main thread: frozen values, no paho in sight."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Subscription:
    """One topic filter. The v5 options fall away on a 3.1.1 connection.

    Attributes:
        live_only: v5 retain handling 2: what is retained at subscribe time is not delivered.
        as_published: v5 retain as published: `retain` tells what the publisher said. Without
            it, it tells the stored copy from a live message, as always on 3.1.1.
    """

    topic_filter: str
    qos: int = 1
    live_only: bool = True
    as_published: bool = True


@dataclass(frozen=True, slots=True)
class OutMessage:
    """One message to publish. `correlation` and `expiry_s` fall away on a 3.1.1 connection."""

    topic: str
    payload: bytes
    qos: int
    retain: bool
    correlation: bytes | None = None
    expiry_s: int | None = None


@dataclass(frozen=True, slots=True)
class Received:
    """A message arrived. `at` is monotonic seconds, taken in the callback.

    Attributes:
        expiry_s: What is left of the v5 message expiry interval, or None.
    """

    topic: str
    payload: bytes
    retain: bool
    at: float
    response_topic: str | None = None
    correlation: bytes | None = None
    expiry_s: int | None = None

    @property
    def size_bytes(self) -> int:
        """Return how much of it is kept in memory, but for what each message has."""
        properties = len(self.response_topic or "") + len(self.correlation or b"")
        return len(self.topic) + len(self.payload) + properties


@dataclass(frozen=True, slots=True)
class Connected:
    """The broker took us and granted the subscriptions; `protocol` is "5" or "3.1.1".

    Attributes:
        at: When we subscribed: the broker took in nothing before that for us.
    """

    protocol: str
    at: float


@dataclass(frozen=True, slots=True)
class Disconnected:
    """The connection ended. What was not acknowledged may or may not have arrived."""

    cause: str
    at: float


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """The broker has the QoS 1 message that `publish` gave this token."""

    token: int


@dataclass(frozen=True, slots=True)
class Subscribed:
    """The broker answered a later `subscribe`; `denied` are the filters that it refused."""

    denied: tuple[str, ...]


MqttEvent = Received | Connected | Disconnected | Acknowledged | Subscribed
