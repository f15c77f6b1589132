"""The entities of each device, in the words of Home Assistant's MQTT integration.

A file a kind of thing: each gives what there is of it on one station, and this one their order.
"""

from collections.abc import Iterable

from bridge.config.schema import LineConfig, StationConfig
from bridge.mqtt.announce.entities import (
    counters,
    covers,
    gestures,
    health,
    inputs,
    measurements,
    outputs,
    settings,
    verdicts,
)
from bridge.mqtt.announce.entities.entity import TRIGGER, Entity, Origin, connectivity
from bridge.mqtt.topics import Topics

__all__ = ["TRIGGER", "Entity", "bridge_entities", "station_entities"]

# Channels first, then how the station is.
_KINDS = (
    inputs.entities,
    gestures.entities,
    counters.entities,
    outputs.entities,
    covers.entities,
    settings.entities,
    health.entities,
    verdicts.entities,
    measurements.entities,
)


def bridge_entities(topics: Topics, lines: Iterable[LineConfig]) -> list[Entity]:
    """Give what there is to see of the bridge itself and of its lines."""
    of_lines = (entity for line in lines for entity in measurements.of_line(topics, line))
    return [connectivity(topics, topics.bridge_state), *of_lines]


def station_entities(topics: Topics, line: LineConfig, station: StationConfig) -> list[Entity]:
    """Give every channel of a station that is not left out, then how the station is."""
    place = Origin(topics, line, station)
    return [entity for kind in _KINDS for entity in kind(place)]
