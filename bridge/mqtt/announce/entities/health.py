"""The health of a device: its connection, and its problem."""

from collections.abc import Iterator

from bridge.mqtt.announce.entities.entity import Entity, Origin, connectivity, diagnostic, indicator


def entities(place: Origin) -> Iterator[Entity]:
    """Yield connection and problem of a station."""
    yield connectivity(place.topics, place.topics.availability(place.config.id))
    yield _problem(place)


def _problem(place: Origin) -> Entity:
    topic = place.topics.problem(place.config.id)
    options = {
        "device_class": "problem",
        "value_template": "{{ value_json.state }}",
        "json_attributes_topic": topic,  # reason, detail and since
        **diagnostic(place.topics),
    }
    return indicator("problem", "Problem", topic, options)
