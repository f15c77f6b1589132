"""The verdicts on commands to a station, so that an automation can wait for one."""

from collections.abc import Iterator

from bridge.model import Status
from bridge.mqtt.announce.entities.entity import Entity, Origin


def entities(place: Origin) -> Iterator[Entity]:
    """Give one event for all outputs of a station; which one it was is an attribute."""
    options = {
        "name": "Verdict",
        "state_topic": place.topics.result(place.station.id),
        "event_types": [str(status) for status in Status],
        # An event names its type; all that a verdict says besides becomes its attributes.
        "value_template": "{{ dict(value_json, event_type=value_json.status) | to_json }}",
        "entity_category": "diagnostic",
        "qos": 1,
        **place.truth,
    }
    yield Entity("result", "event", options)
