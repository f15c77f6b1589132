"""The entities of each device, in the words of Home Assistant's MQTT integration."""

from dataclasses import dataclass
from typing import Any

from bridge.config.schema import InputConfig, LineConfig, OutputConfig, StationConfig
from bridge.mqtt.topics import Topics

_ON_OFF = {"payload_on": "ON", "payload_off": "OFF"}
_ON_OFF_STATES = {"state_on": "ON", "state_off": "OFF"}
_WORDS: dict[str, dict[str, Any]] = {
    # homeassistant/components/mqtt/PLATFORM.py: how each names what ON and OFF are to it. The
    # words on the wire are the same for all of them (CONTRACT.md, Topics): ON lets through.
    "switch": {**_ON_OFF, **_ON_OFF_STATES},
    "light": _ON_OFF,
    "fan": _ON_OFF,
    "siren": {
        **_ON_OFF,
        **_ON_OFF_STATES,
        # Without it a siren is switched by a JSON object of what it should play, and how loud.
        "command_template": "{{ value }}",
        "support_duration": False,
        "support_volume_set": False,
    },
    "valve": {
        "payload_open": "ON",
        "payload_close": "OFF",
        "state_open": "ON",
        "state_closed": "OFF",
        "reports_position": False,
    },
    "lock": {
        "payload_unlock": "ON",
        "payload_lock": "OFF",
        "state_unlocked": "ON",
        "state_locked": "OFF",
    },
}


@dataclass(frozen=True, slots=True)
class Entity:
    """One entity of a device.

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
        """Its name within the device, which no other entity has: `do_1_switch`."""
        return f"{self.object}_{self.platform}"


def bridge_entities(topics: Topics) -> list[Entity]:
    """Gives what there is to see of the bridge itself."""
    return [_connectivity(topics, topics.bridge_state)]


def station_entities(topics: Topics, line: LineConfig, station: StationConfig) -> list[Entity]:
    """Gives every channel of a station that is not left out, then how the station is."""
    truth = _availability(
        # CONTRACT.md, Order and truth: a value is true while all three say so.
        topics.bridge_state,
        topics.line_availability(line.id),
        topics.availability(station.id),
    )
    entities = [_input(topics, station, channel, truth) for channel in station.inputs]
    for output in station.outputs:
        entities += _output(topics, station, output, truth)
    return [
        *entities,
        _connectivity(topics, topics.availability(station.id)),
        _problem(topics, station),
    ]


def _input(
    topics: Topics, station: StationConfig, channel: InputConfig, truth: dict[str, Any]
) -> Entity:
    name = channel.name or f"Input {channel.channel}"
    device_class = {"device_class": channel.device_class} if channel.device_class else {}
    return _indicator(
        f"di_{channel.channel}",
        name,
        topics.channel(station.id, "di", channel.channel),
        {**device_class, **truth},
    )


def _output(
    topics: Topics, station: StationConfig, output: OutputConfig, truth: dict[str, Any]
) -> list[Entity]:
    """Gives a control, an indicator, or for a pulse both: a pulse cannot be switched OFF."""
    name = output.name or f"Output {output.channel}"
    subject = f"do_{output.channel}"
    state_topic = topics.channel(station.id, "do", output.channel)
    shared = {"name": name, "command_topic": f"{state_topic}/set", "qos": 1, **truth}
    if output.read_only:
        return [_indicator(subject, name, state_topic, truth)]
    if output.mode == "pulse":
        return [
            Entity(subject, "button", {"payload_press": "PRESS", **shared}),
            _indicator(subject, name, state_topic, truth),
        ]
    # Not optimistic: an output is shown as the module reported it, never as asked.
    options = {"state_topic": state_topic, "optimistic": False, **_WORDS[output.kind], **shared}
    return [Entity(subject, output.kind, options)]


def _connectivity(topics: Topics, state_topic: str) -> Entity:
    options = {
        "device_class": "connectivity",
        **_diagnostic(topics),
        "payload_on": "online",
        "payload_off": "offline",
    }
    return _indicator("connectivity", "Connection", state_topic, options)


def _problem(topics: Topics, station: StationConfig) -> Entity:
    topic = topics.problem(station.id)
    options = {
        "device_class": "problem",
        "value_template": "{{ value_json.state }}",
        "json_attributes_topic": topic,  # reason, detail and since
        **_diagnostic(topics),
    }
    return _indicator("problem", "Problem", topic, options)


def _diagnostic(topics: Topics) -> dict[str, Any]:
    # These tell of a station that does not answer: they must not go away together with it.
    return {"entity_category": "diagnostic", **_availability(topics.bridge_state)}


def _indicator(subject: str, name: str, state_topic: str, options: dict[str, Any]) -> Entity:
    known = {"name": name, "state_topic": state_topic, **_ON_OFF, "qos": 1}
    return Entity(subject, "binary_sensor", {**known, **options})


def _availability(*topics: str) -> dict[str, Any]:
    words = {"payload_available": "online", "payload_not_available": "offline"}
    return {
        "availability": [{"topic": topic, **words} for topic in topics],
        "availability_mode": "all",
    }
