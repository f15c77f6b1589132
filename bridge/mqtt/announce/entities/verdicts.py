"""The verdicts on commands to a station, and what the bridge did there by itself."""

from collections.abc import Iterator

from bridge.config.schema import StationConfig
from bridge.model import Status
from bridge.mqtt.announce.entities.entity import Entity, Origin

# At `done` the sensor keeps its state: a refusal is not over because another command was done.
_REFUSAL = (
    "{% if value_json.status == 'done' %}{{ this.state }}"
    "{% else %}{{ value_json.target }}: {{ value_json.reason | default(value_json.status) "
    "| replace('_', ' ') }}{% endif %}"
)


def entities(place: Origin) -> Iterator[Entity]:
    """Yield an event, the last refusal and the last own action of a station."""
    told = {"entity_category": "diagnostic", "qos": 1, **place.bridge_alone}
    result = place.topics.result(place.config.id)
    options = {
        "name": "Verdict",
        "state_topic": result,
        "event_types": [str(status) for status in Status],
        # `status` is the type of the event; the other keys of a verdict become its attributes.
        "value_template": "{{ dict(value_json, event_type=value_json.status) | to_json }}",
        **told,
    }
    yield Entity("result", "event", options)
    refusal = {"name": "Last refusal", "state_topic": result, "value_template": _REFUSAL, **told}
    yield Entity("last_refusal", "sensor", refusal)
    if place.ruled or _acts_by_itself(place.config):
        topic = place.topics.own_actions(place.config.id)
        # It is retained: it tells what was done while no client listened.
        action = {
            "name": "Last own action",
            "state_topic": topic,
            "value_template": "{{ value_json.last }}",
            "json_attributes_topic": topic,
            "json_attributes_template": "{{ {'actions': value_json.actions} | to_json }}",
            **told,
        }
        yield Entity("own_action", "sensor", action)


def _acts_by_itself(config: StationConfig) -> bool:
    """Return whether its own keys switch something there without a command."""
    orders = any(output.max_on_s is not None or output.on_loss for output in config.outputs)
    return orders or bool(config.covers)
