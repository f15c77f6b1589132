"""The entities of a small house, by component id."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from support.house import GARAGE, make_config

from bridge.config.schema import LineConfig, OutputConfig, RuleConfig, StationConfig
from bridge.mqtt.announce.entities import Entity, bridge_entities, station_entities
from bridge.mqtt.announce.words import WORDS
from bridge.mqtt.topics import Topics

TOPICS = Topics("wisco")
LINE = make_config().lines[0]


def by_id(entities: Iterable[Entity]) -> dict[str, dict[str, Any]]:
    """Gives each entity's options by its component id."""
    return {entity.component_id: entity.options for entity in entities}


def of_bridge(*rules: RuleConfig) -> dict[str, dict[str, Any]]:
    """Gives the entities of the bridge with its one line, `main`, and its rules."""
    return by_id(bridge_entities(TOPICS, [LINE], rules))


def of_station(
    config: StationConfig = GARAGE, line: LineConfig = LINE, language: str = "en"
) -> dict[str, Any]:
    """Gives the entities of a station, the garage's if none is named."""
    return by_id(station_entities(TOPICS, line, config, WORDS[language]))


def of_output(output: OutputConfig, line: LineConfig = LINE) -> dict[str, dict[str, Any]]:
    """Gives what a station has for its only output."""
    found = of_station(replace(GARAGE, inputs=(), outputs=(output,)), line)
    return {key: value for key, value in found.items() if key.startswith("do_")}
