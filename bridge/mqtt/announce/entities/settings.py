"""Modes and hold times that the configuration leaves to Home Assistant."""

from collections.abc import Iterator
from typing import Any

from bridge.config.schema import OutputConfig
from bridge.model import bit
from bridge.mqtt.announce.entities.entity import Entity, Origin

# A setting that could not be read has an empty payload, which is no mode and no number.
_UNREAD_IS_UNKNOWN = "{{ value or 'None' }}"
_SECONDS = {"min": 0.1, "max": 25.5, "step": 0.1}  # docs/protocol.md section 3, register 40,021


def entities(place: Origin) -> Iterator[Entity]:
    """Yield a select for each undeclared mode and a number for each undeclared hold time.

    A declared latch uses no hold time. Settings go in Modbus frames alone.
    """
    if not place.line.asks_modbus(place.config):
        return
    for output in place.config.outputs:
        if output.read_only or place.config.cover_outputs & bit(output.channel):
            continue
        if output.mode is None:
            yield _mode(place, output)
        if output.hold_s is None and output.mode != "latch":
            yield _hold(place, output)


def _mode(place: Origin, output: OutputConfig) -> Entity:
    topic = place.topics.mode(place.config.id, output.channel)
    options = {"options": ["latch", "pulse"], **_shared(place, output, place.words.mode, topic)}
    return Entity(f"do_{output.channel}_mode", "select", options)


def _hold(place: Origin, output: OutputConfig) -> Entity:
    topic = place.topics.hold(place.config.id, output.channel)
    unit = {"mode": "box", "unit_of_measurement": "s", "device_class": "duration"}
    options = {**_SECONDS, **unit, **_shared(place, output, place.words.hold_time, topic)}
    return Entity(f"do_{output.channel}_hold", "number", options)


def _shared(place: Origin, output: OutputConfig, setting: str, topic: str) -> dict[str, Any]:
    return {
        "name": f"{output.name or f'Output {output.channel}'} {setting}",
        "entity_category": "config",
        "enabled_by_default": False,
        "state_topic": topic,
        "command_topic": f"{topic}/set",
        "value_template": _UNREAD_IS_UNKNOWN,
        "optimistic": False,
        "qos": 1,
        **place.truth,
    }
