"""Inputs: one binary sensor each."""

from collections.abc import Iterator

from bridge.config.schema import InputConfig
from bridge.mqtt.announce.entities.entity import Entity, Origin, indicator


def entities(place: Origin) -> Iterator[Entity]:
    """Yield the inputs that are not left out."""
    yield from (_input(place, channel) for channel in place.config.inputs)


def name_of(channel: InputConfig) -> str:
    """Return the configured name, or the number of the input."""
    return channel.name or f"Input {channel.channel}"


def subject_of(channel: InputConfig) -> str:
    """Return the beginning of the ids of its entities."""
    return f"di_{channel.channel}"


def _input(place: Origin, channel: InputConfig) -> Entity:
    topic = place.topics.channel(place.config.id, "di", channel.channel)
    device_class = {"device_class": channel.device_class} if channel.device_class else {}
    options = {**device_class, **place.truth}
    return indicator(subject_of(channel), name_of(channel), topic, options)
