"""The retained topics of lines and stations, in the order of a connect (docs/contract.md)."""

from collections.abc import Iterator

from bridge.config.schema import Config, StationConfig
from bridge.mqtt.topics import Topics


def in_order(config: Config, topics: Topics) -> Iterator[str]:
    """Yield all of them."""
    yield from availability(config, topics)
    yield from states(config, topics)
    yield from (topics.line_diagnostics(line.id) for line in config.lines)
    yield from (topics.diagnostics(station_config.id) for _, station_config in config.all_stations)


def availability(config: Config, topics: Topics) -> Iterator[str]:
    """Yield those that say whether a line or a station is there."""
    yield from (topics.line_availability(line.id) for line in config.lines)
    yield from (topics.availability(station_config.id) for _, station_config in config.all_stations)


def states(config: Config, topics: Topics) -> Iterator[str]:
    """Yield those of channels, modules and rules."""
    for _, station_config in config.all_stations:
        yield from _states(station_config, topics)
    yield from (topics.rule_state(rule.id) for rule in config.rules)


def _states(config: StationConfig, topics: Topics) -> Iterator[str]:
    name = config.id
    yield from (topics.channel(name, "di", channel.channel) for channel in config.inputs)
    yield from (topics.channel(name, "do", output.channel) for output in config.outputs)
    yield topics.snapshot(name)
    yield from (topics.count(name, c.channel) for c in config.inputs if c.count is not None)
    for output in config.outputs:
        yield topics.mode(name, output.channel)
        yield topics.hold(name, output.channel)
    for cover in config.covers:
        yield topics.cover_position(name, cover.id)
        yield topics.cover_state(name, cover.id)
    yield topics.problem(name)
    yield topics.own_actions(name)
