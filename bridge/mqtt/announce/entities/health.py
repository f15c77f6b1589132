"""How a device is: whether it is there, and whether it needs its owner."""

from collections.abc import Iterator

from bridge.mqtt.announce.entities.entity import (
    Entity,
    StationOnLine,
    connectivity,
    diagnostic,
    indicator,
)


def entities(place: StationOnLine) -> Iterator[Entity]:
    """Give the connection and the problem of a station."""
    yield connectivity(place.topics, place.topics.availability(place.station.id))
    yield _problem(place)


def _problem(place: StationOnLine) -> Entity:
    topic = place.topics.problem(place.station.id)
    options = {
        "device_class": "problem",
        "value_template": "{{ value_json.state }}",
        "json_attributes_topic": topic,  # reason, detail and since
        **diagnostic(place.topics),
    }
    return indicator("problem", "Problem", topic, options)
