"""Outputs: controls of relays, or indicators."""

from collections.abc import Iterator
from typing import Any

from bridge.config.schema import OutputConfig
from bridge.model import bit
from bridge.mqtt.announce.entities.entity import ON_OFF, Entity, Origin, indicator

_ON_OFF_STATES = {"state_on": "ON", "state_off": "OFF"}
_WORDS: dict[str, dict[str, Any]] = {
    # homeassistant/components/mqtt/PLATFORM.py: the words of each platform for ON and OFF. ON opens
    # a valve and unlocks a lock.
    "switch": {**ON_OFF, **_ON_OFF_STATES},
    "light": ON_OFF,
    "fan": ON_OFF,
    "siren": {
        **ON_OFF,
        **_ON_OFF_STATES,
        # Without it Home Assistant switches a siren with a JSON object (tone, volume).
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


def entities(place: Origin) -> Iterator[Entity]:
    """Yield the outputs that are not left out."""
    for output in place.config.outputs:
        yield from _output(place, output)


def _output(place: Origin, output: OutputConfig) -> list[Entity]:
    """Return a control or an indicator; both for a pulse, which cannot be switched OFF."""
    name = output.name or f"Output {output.channel}"
    subject = f"do_{output.channel}"
    state_topic = place.topics.channel(place.config.id, "do", output.channel)
    shared = {"name": name, "command_topic": f"{state_topic}/set", "qos": 1, **place.truth}
    relay = f"{name} {place.words.relay}"  # the name alone is that of the button or the cover
    if place.config.cover_outputs & bit(output.channel):
        options = {"entity_category": "diagnostic", **place.truth}
        return [indicator(subject, relay, state_topic, options)]
    if output.read_only:
        return [indicator(subject, name, state_topic, place.truth)]
    if output.mode == "pulse":
        shown = indicator(subject, relay, state_topic, place.truth)
        return [Entity(subject, "button", {"payload_press": "PRESS", **shared}), shown]
    # Not optimistic: the state is the one that the module reported.
    options = {"state_topic": state_topic, "optimistic": False, **_WORDS[output.kind], **shared}
    return [Entity(subject, output.kind, options)]
