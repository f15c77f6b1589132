"""Buttons: one event each, and a device trigger for each gesture."""

from collections.abc import Iterator

from bridge.config.schema import GestureConfig, InputConfig
from bridge.model import Gesture
from bridge.mqtt.announce.entities.entity import TRIGGER, Entity, Origin
from bridge.mqtt.announce.entities.inputs import name_of, subject_of

# homeassistant/components/mqtt/strings.json: the types that Home Assistant has words for.
_TYPES = {
    Gesture.SHORT: "button_short_press",
    Gesture.LONG: "button_long_press",
    Gesture.DOUBLE: "button_double_press",
}


def entities(place: Origin) -> Iterator[Entity]:
    """Yield event and triggers of each button."""
    for channel in place.config.inputs:
        if channel.gestures is not None:
            gestures = list(_gestures(channel.gestures))
            yield _event(place, channel, gestures)
            yield from (_trigger(place, channel, gesture) for gesture in gestures)


def _gestures(config: GestureConfig) -> Iterator[Gesture]:
    """Yield the gestures that are possible."""
    yield from (Gesture.SHORT, Gesture.LONG)
    if config.double_s > 0:
        yield Gesture.DOUBLE


def _event(place: Origin, channel: InputConfig, gestures: list[Gesture]) -> Entity:
    options = {
        "name": f"{name_of(channel)} {place.words.press}",
        "state_topic": place.topics.event(place.config.id, channel.channel),
        "event_types": gestures,
        "device_class": "button",
        # The module's return must not look like a press: the last one would show anew.
        **place.bridge_alone,
    }
    return Entity(subject_of(channel), "event", options)


def _trigger(place: Origin, channel: InputConfig, gesture: Gesture) -> Entity:
    """Return a trigger. Automations store device, type and subtype: the subtype must not change."""
    subject = subject_of(channel)
    options = {
        "automation_type": "trigger",
        "type": _TYPES[gesture],
        "subtype": subject,
        "topic": place.topics.event(place.config.id, channel.channel),
        "payload": gesture,
        "value_template": "{{ value_json.event_type }}",
    }
    return Entity(f"{subject}_{gesture}", TRIGGER, options)
