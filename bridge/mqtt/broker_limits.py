"""The limits of a broker, from its CONNACK: a pure value. Only MQTT 5 has them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

from bridge.mqtt.events import OutMessage
from bridge.mqtt.incoming import as_number

_OPEN_WINDOW = 65_535

_NO_RETAIN = (
    "the broker keeps no retained messages: a program that starts later sees no state before it "
    "changes, and Home Assistant only after its birth message. Allow retained messages there"
)
_NO_WILDCARDS = (
    "the broker allows no wildcards: each command topic is subscribed by itself, commands to "
    "unknown stations are not seen, and what it retains of earlier configurations is not "
    "cleared. Allow wildcard subscriptions there"
)
_NO_QOS = (
    "the broker takes QoS 0 alone: states, verdicts and commands can be lost on the way without a "
    "word. Allow QoS 1 there"
)


@dataclass(frozen=True, slots=True)
class BrokerLimits:
    """The limits of a broker; what it does not mention is allowed.

    Attributes:
        packet_bytes: The longest packet; None: no limit.
        qos: The highest QoS.
        retain: It supports retained messages.
        wildcards: It accepts filters with `+` and `#`.
        window: The most unacknowledged messages.
        client_id: The client id that it assigned in place of ours, if it did.
    """

    packet_bytes: int | None = None
    qos: int = 2
    retain: bool = True
    wildcards: bool = True
    window: int = _OPEN_WINDOW
    client_id: str | None = None

    @classmethod
    def of(cls, properties: object) -> Self:
        """Return the limits in the properties of a CONNACK."""
        return cls(
            packet_bytes=getattr(properties, "MaximumPacketSize", None),
            qos=getattr(properties, "MaximumQoS", 2),
            retain=bool(getattr(properties, "RetainAvailable", True)),
            wildcards=bool(getattr(properties, "WildcardSubscriptionAvailable", True)),
            window=getattr(properties, "ReceiveMaximum", _OPEN_WINDOW),
            client_id=getattr(properties, "AssignedClientIdentifier", None),
        )

    def allowed(self, message: OutMessage) -> OutMessage | None:
        """Return `message` as the broker accepts it; None: it would have another meaning there."""
        if message.retain and not self.retain:
            if not message.payload:
                return None  # it clears a topic, and nothing is retained
            message = replace(message, retain=False)
        return message if message.qos <= self.qos else replace(message, qos=self.qos)

    def restrictions(self) -> Iterator[tuple[str, str]]:
        """Yield what does not work with this broker: a name, and a line for the log."""
        if not self.retain:
            yield "retain", _NO_RETAIN
        if not self.wildcards:
            yield "wildcards", _NO_WILDCARDS
        if self.qos == 0:
            yield "QoS", _NO_QOS
        if self.client_id is not None:
            yield "client id", f"the broker gave us the client id {self.client_id!r}"


def packet_bytes(message: OutMessage, *, has_properties: bool) -> int:
    """Return the length of the PUBLISH packet of `message`, with its header."""
    body = 2 + len(message.topic.encode()) + (2 if message.qos else 0) + len(message.payload)
    if has_properties:
        properties = 0 if message.expiry_s is None else 5
        properties += 0 if message.correlation is None else 3 + len(message.correlation)
        body += len(as_number(properties)) + properties
    return 1 + len(as_number(body)) + body
