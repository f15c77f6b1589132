"""Inputs: a binary sensor each."""

from collections.abc import Iterator

from bridge.config.schema import InputConfig
from bridge.mqtt.entities.entity import Entity, Place, indicator


def entities(place: Place) -> Iterator[Entity]:
    """Gives the inputs that are not left out."""
    yield from (_input(place, channel) for channel in place.station.inputs)


def _input(place: Place, channel: InputConfig) -> Entity:
    name = channel.name or f"Input {channel.channel}"
    topic = place.topics.channel(place.station.id, "di", channel.channel)
    device_class = {"device_class": channel.device_class} if channel.device_class else {}
    return indicator(f"di_{channel.channel}", name, topic, {**device_class, **place.truth})
