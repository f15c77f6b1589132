"""How a device is: whether it is there, and whether it needs its owner."""

from collections.abc import Iterator

from bridge.mqtt.entities.entity import Entity, Place, diagnostic, indicator
from bridge.mqtt.topics import Topics


def entities(place: Place) -> Iterator[Entity]:
    """Gives the connection and the problem of a station."""
    yield connectivity(place.topics, place.topics.availability(place.station.id))
    yield _problem(place)


def connectivity(topics: Topics, state_topic: str) -> Entity:
    """Whether what says `online` or `offline` at `state_topic` is there."""
    words = {"payload_on": "online", "payload_off": "offline"}
    options = {"device_class": "connectivity", **diagnostic(topics), **words}
    return indicator("connectivity", "Connection", state_topic, options)


def _problem(place: Place) -> Entity:
    topic = place.topics.problem(place.station.id)
    options = {
        "device_class": "problem",
        "value_template": "{{ value_json.state }}",
        "json_attributes_topic": topic,  # reason, detail and since
        **diagnostic(place.topics),
    }
    return indicator("problem", "Problem", topic, options)
