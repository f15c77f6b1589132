"""The type of an entity, and the common parts of all kinds."""

from dataclasses import dataclass, field
from typing import Any

from bridge.config.schema import LineConfig, StationConfig
from bridge.mqtt.announce.words import Words
from bridge.mqtt.topics import Topics

# The words on the wire are the same for every platform (docs/topics.md).
ON_OFF = {"payload_on": "ON", "payload_off": "OFF"}

# The platform of device triggers. They are not entities: Home Assistant identifies them only by
# device, type and subtype.
TRIGGER = "device_automation"


@dataclass(frozen=True, slots=True)
class Entity:
    """One entity of a device, or one of its triggers.

    Attributes:
        object: Its subject: `do_1`. Entity ids end with it.
        platform: The Home Assistant platform.
        options: The keys for the schema of the platform.
        single_options: Further keys in `single` discovery, for releases before 2024.11.
    """

    object: str
    platform: str
    options: dict[str, Any]
    single_options: dict[str, Any] = field(default_factory=dict)

    @property
    def component_id(self) -> str:
        """Return its name, unique within the device: `do_1_switch`."""
        return f"{self.object}_{self.platform}"


@dataclass(frozen=True, slots=True)
class Origin:
    """A station on its line; `ruled`: a rule switches something there."""

    topics: Topics
    line: LineConfig
    config: StationConfig
    words: Words
    ruled: bool = False

    @property
    def bridge_alone(self) -> dict[str, Any]:
        """Return the availability of an event: no return of line or module fires it again."""
        return availability(self.topics.bridge_state)

    @property
    def truth(self) -> dict[str, Any]:
        """Return the availability of a value: bridge, line and station must be online.

        See docs/contract.md, Order and truth.
        """
        return availability(
            self.topics.bridge_state,
            self.topics.line_availability(self.line.id),
            self.topics.availability(self.config.id),
        )


def indicator(subject: str, name: str, state_topic: str, options: dict[str, Any]) -> Entity:
    """Return a binary sensor for `ON` and `OFF`, unless `options` have other words."""
    known = {"name": name, "state_topic": state_topic, **ON_OFF, "qos": 1}
    return Entity(subject, "binary_sensor", {**known, **options})


def connectivity(
    topics: Topics, state_topic: str, subject: str = "connectivity", name: str = "Connection"
) -> Entity:
    """Return a binary sensor for the `online` or `offline` at `state_topic`."""
    words = {"payload_on": "online", "payload_off": "offline"}
    options = {"device_class": "connectivity", **diagnostic(topics), **words}
    return indicator(subject, name, state_topic, options)


def diagnostic(topics: Topics) -> dict[str, Any]:
    """Return the keys of a diagnostic entity: available while the bridge is.

    It has to stay available when its station does not answer.
    """
    return {"entity_category": "diagnostic", **availability(topics.bridge_state)}


def availability(*topics: str) -> dict[str, Any]:
    """Return the availability by `topics`: all of them must be `online`.

    The words are left out because they are the defaults of Home Assistant. Written three times in
    each entity, they would be a quarter of all announcements.
    """
    return {"availability": [{"topic": topic} for topic in topics], "availability_mode": "all"}
