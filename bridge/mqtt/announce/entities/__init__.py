"""The entities of each device, in the terms of Home Assistant's MQTT integration.

Each file has one kind of entity and returns those of one station; this file sets their order.
"""

from collections.abc import Iterable
from dataclasses import replace

from bridge.config.schema import LineConfig, RuleConfig, StationConfig
from bridge.mqtt.announce.entities import (
    counters,
    covers,
    gestures,
    health,
    inputs,
    measurements,
    outputs,
    rules,
    settings,
    verdicts,
)
from bridge.mqtt.announce.entities.entity import TRIGGER, Entity, Origin, connectivity
from bridge.mqtt.announce.words import Words
from bridge.mqtt.topics import Topics

__all__ = ["TRIGGER", "Entity", "bridge_entities", "station_entities"]

# Channels first, then the health of the station.
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


def bridge_entities(
    topics: Topics, lines: Iterable[LineConfig], switched: Iterable[RuleConfig] = ()
) -> list[Entity]:
    """Return the entities of the bridge itself, of its lines and of its rules."""
    of_lines = (entity for line in lines for entity in measurements.of_line(topics, line))
    bridge = connectivity(topics, topics.bridge_state)
    # Its `off` is the last will: with that as its availability too it could never be off.
    always = {k: v for k, v in bridge.options.items() if not k.startswith("availability")}
    return [replace(bridge, options=always), *of_lines, *rules.entities(topics, switched)]


def station_entities(
    topics: Topics, line: LineConfig, config: StationConfig, words: Words, *, ruled: bool = False
) -> list[Entity]:
    """Return the entities of the channels of a station, then those of its health."""
    place = Origin(topics, line, config, words, ruled)
    return [entity for kind in _KINDS for entity in kind(place)]
