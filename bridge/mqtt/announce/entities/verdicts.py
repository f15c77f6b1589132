"""The verdicts on commands to a station, so that an automation can wait for one."""

from collections.abc import Iterator

from bridge.model import Status
from bridge.mqtt.announce.entities.entity import Entity, Origin


def entities(place: Origin) -> Iterator[Entity]:
    """Yield one event for all outputs of a station; the output is an attribute."""
    options = {
        "name": "Verdict",
        "state_topic": place.topics.result(place.station.id),
        "event_types": [str(status) for status in Status],
        # `status` is the type of the event; the other keys of a verdict become its attributes.
        "value_template": "{{ dict(value_json, event_type=value_json.status) | to_json }}",
        "entity_category": "diagnostic",
        "qos": 1,
        **place.truth,
    }
    yield Entity("result", "event", options)
