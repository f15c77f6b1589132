"""Frozen values between the MQTT client and the main thread; no type of paho."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Subscription:
    """One topic filter. The MQTT 5 options are dropped on a 3.1.1 connection.

    Attributes:
        live_only: Retain handling 2: retained messages are not delivered at subscribe time.
        as_published: Retain as published: `retain` is the flag of the publisher. Without it, and
            always on 3.1.1, the flag marks the stored copy.
    """

    topic_filter: str
    qos: int = 1
    live_only: bool = True
    as_published: bool = True


@dataclass(frozen=True, slots=True)
class OutMessage:
    """A message to publish. `correlation` and `expiry_s` are dropped on a 3.1.1 connection."""

    topic: str
    payload: bytes
    qos: int
    retain: bool
    correlation: bytes | None = None
    expiry_s: int | None = None


@dataclass(frozen=True, slots=True)
class Received:
    """A message that arrived at `at` (`bridge.clock.boot_s`, read in the callback).

    Attributes:
        expiry_s: The rest of the MQTT 5 message expiry interval, or None.
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
        """Return how much memory its content takes."""
        properties = len(self.response_topic or "") + len(self.correlation or b"")
        return len(self.topic) + len(self.payload) + properties


@dataclass(frozen=True, slots=True)
class Connected:
    """The broker accepted us and granted the subscriptions; `protocol` is "5" or "3.1.1".

    Attributes:
        at: When we subscribed: the broker accepted nothing for us before that.
    """

    protocol: str
    at: float


@dataclass(frozen=True, slots=True)
class Disconnected:
    """The connection ended. Unacknowledged messages may or may not have arrived."""

    cause: str
    at: float


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """The broker acknowledged the QoS 1 message to which `publish` gave this token."""

    token: int


@dataclass(frozen=True, slots=True)
class Subscribed:
    """The broker answered a later `subscribe`; `denied` are the filters that it refused."""

    denied: tuple[str, ...]


MqttEvent = Received | Connected | Disconnected | Acknowledged | Subscribed
