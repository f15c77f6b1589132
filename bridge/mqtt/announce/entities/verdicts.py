"""The verdicts on commands to a station, so that an automation can wait for one."""

from collections.abc import Iterator

from bridge.model import Status
from bridge.mqtt.announce.entities.entity import Entity, Origin

# At `done` the sensor keeps its state: a refusal is not over because another command was done.
_REFUSAL = (
    "{% if value_json.status == 'done' %}{{ this.state }}"
    "{% else %}{{ value_json.target }}: {{ value_json.reason | default(value_json.status) "
    "| replace('_', ' ') }}{% endif %}"
)


def entities(place: Origin) -> Iterator[Entity]:
    """Yield an event and the last refusal, for all outputs of a station together."""
    options = {
        "name": "Verdict",
        "state_topic": place.topics.result(place.station.id),
        "event_types": [str(status) for status in Status],
        # `status` is the type of the event; the other keys of a verdict become its attributes.
        "value_template": "{{ dict(value_json, event_type=value_json.status) | to_json }}",
        "entity_category": "diagnostic",
        "qos": 1,
        **place.bridge_alone,
    }
    yield Entity("result", "event", options)
    refusal = {
        "name": "Last refusal",
        "state_topic": place.topics.result(place.station.id),
        "value_template": _REFUSAL,
        "entity_category": "diagnostic",
        "qos": 1,
        **place.bridge_alone,
    }
    yield Entity("last_refusal", "sensor", refusal)
