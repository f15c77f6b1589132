"""A configuration for tests of the MQTT side, and a broker connection that only remembers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bridge.config.schema import (
    Config,
    HomeAssistantConfig,
    InputConfig,
    LineConfig,
    MqttConfig,
    OutputConfig,
    StationConfig,
)
from bridge.model import DIO100, DO100, LineProtocol
from bridge.mqtt.events import OutMessage, Subscription

GARAGE = StationConfig(
    address=1,
    model=DIO100,
    id="garage",
    name="Garage Süd",
    inputs=(InputConfig(1, name="Door"), InputConfig(16)),
    outputs=(OutputConfig(1, name="Lamp"), OutputConfig(2), OutputConfig(4)),
)
ATTIC = StationConfig(
    address=13, model=DO100, id="attic", name="Attic", inputs=(), outputs=(OutputConfig(16),)
)
MAIN = LineConfig(
    id="main",
    port="tcp://10.0.0.5:4196",
    baud=9600,
    protocol=LineProtocol.WISCO,
    stations=(GARAGE, ATTIC),
)
CONFIG = Config(
    mqtt=MqttConfig("localhost", 1883, "wisco", "me", "auto", "wisco", "s3cret"),
    homeassistant=HomeAssistantConfig("device", "homeassistant", "homeassistant/status"),
    state_dir=Path("/nowhere"),
    lines=(MAIN,),
)


@dataclass
class FakeConnection:
    """Stands for `MqttClient`: remembers what was handed to it, acknowledges nothing."""

    up: bool = True
    sent: list[OutMessage] = field(default_factory=list)
    unacknowledged: list[int] = field(default_factory=list)
    tokens: int = 0
    filters: list[str] = field(default_factory=list)
    leave_mute: Callable[[], None] = lambda: None
    renewed: list[str] = field(default_factory=list)

    def publish(self, message: OutMessage) -> int | None:
        """Gives a token for each message, or None while the connection is down."""
        if not self.up:
            return None
        self.tokens += 1
        self.sent.append(message)
        if message.qos:
            self.unacknowledged.append(self.tokens)
        return self.tokens

    def connect_anew(self, why: str) -> None:
        """Remembers why."""
        self.renewed.append(why)

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """Remembers what is listened to besides the usual."""
        self.filters += [one.topic_filter for one in subscriptions]

    def unsubscribe(self, topic_filters: Sequence[str]) -> None:
        """Forgets some of that."""
        for one in topic_filters:
            self.filters.remove(one)

    def taken(self) -> list[OutMessage]:
        """Return the messages since the last call."""
        taken, self.sent = self.sent, []
        return taken

    def pairs(self) -> list[tuple[str, bytes]]:
        """The same as topics and payloads."""
        return [(message.topic, message.payload) for message in self.taken()]
