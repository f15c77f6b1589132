"""Counted inputs: one sensor each."""

from collections.abc import Iterator
from decimal import Decimal
from typing import Any

from bridge.config.schema import CountConfig, InputConfig
from bridge.mqtt.announce.entities.entity import Entity, Origin
from bridge.mqtt.announce.entities.inputs import name_of, subject_of


def entities(place: Origin) -> Iterator[Entity]:
    """Yield the sensors of the counted inputs."""
    for channel in place.config.inputs:
        if channel.count is not None:
            yield _sensor(place, channel, channel.count)


def _sensor(place: Origin, channel: InputConfig, count: CountConfig) -> Entity:
    options = {
        "name": f"{name_of(channel)} {place.words.count}",
        "state_topic": place.topics.count(place.config.id, channel.channel),
        "state_class": "total_increasing",
        "qos": 1,
        **_meaning(count),
        **place.truth,
    }
    return Entity(subject_of(channel), "sensor", options)


def _meaning(count: CountConfig) -> dict[str, Any]:
    """Return unit and template: the topic has edges, and Home Assistant multiplies."""
    options = {
        "unit_of_measurement": count.unit,
        "device_class": count.device_class,
        "value_template": None if count.factor is None else _times(count.factor),
    }
    return {key: value for key, value in options.items() if value is not None}


def _times(factor: Decimal) -> str:
    """Return the multiplication, rounded to the decimals of the factor."""
    decimals = max(0, -int(factor.as_tuple().exponent))
    return f"{{{{ (value | int * {factor:f}) | round({decimals}) }}}}"
