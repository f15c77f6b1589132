"""What an entity is, and what entities of every kind have in common."""

from dataclasses import dataclass
from typing import Any

from bridge.config.schema import LineConfig, StationConfig
from bridge.mqtt.topics import Topics

# The words on the wire are the same for every platform (docs/topics.md).
ON_OFF = {"payload_on": "ON", "payload_off": "OFF"}

# The platform of device triggers. They are no entities: Home Assistant knows them by their device,
# type and subtype, and nothing else of what entities have.
TRIGGER = "device_automation"


@dataclass(frozen=True, slots=True)
class Entity:
    """One entity of a device, or one of its triggers.

    Attributes:
        object: What it is about: `do_1`. Entity ids end in it.
        platform: The Home Assistant platform that it belongs to.
        options: What that platform's schema wants to know.
    """

    object: str
    platform: str
    options: dict[str, Any]

    @property
    def component_id(self) -> str:
        """Return its name within the device, which no other entity has: `do_1_switch`."""
        return f"{self.object}_{self.platform}"


@dataclass(frozen=True, slots=True)
class Origin:
    """A station on its line: what its entities are made from."""

    topics: Topics
    line: LineConfig
    station: StationConfig

    @property
    def truth(self) -> dict[str, Any]:
        """Return when a value of the station is true (docs/contract.md, Order and truth).

        All three say so.
        """
        return availability(
            self.topics.bridge_state,
            self.topics.line_availability(self.line.id),
            self.topics.availability(self.station.id),
        )


def indicator(subject: str, name: str, state_topic: str, options: dict[str, Any]) -> Entity:
    """Return a binary sensor that reads `ON` and `OFF`, unless `options` say other words."""
    known = {"name": name, "state_topic": state_topic, **ON_OFF, "qos": 1}
    return Entity(subject, "binary_sensor", {**known, **options})


def connectivity(
    topics: Topics, state_topic: str, subject: str = "connectivity", name: str = "Connection"
) -> Entity:
    """Return whether what says `online` or `offline` at `state_topic` is there."""
    words = {"payload_on": "online", "payload_off": "offline"}
    options = {"device_class": "connectivity", **diagnostic(topics), **words}
    return indicator(subject, name, state_topic, options)


def diagnostic(topics: Topics) -> dict[str, Any]:
    """Return what tells of a station that does not answer: it must not go away together with it."""
    return {"entity_category": "diagnostic", **availability(topics.bridge_state)}


def availability(*topics: str) -> dict[str, Any]:
    """Return an entity is there while every one of `topics` says `online`.

    The words are left out: they are what Home Assistant expects of itself, and three times in
    each entity they would make up a quarter of all that is announced.
    """
    return {
        "availability": [{"topic": topic} for topic in topics],
        "availability_mode": "all",
    }
