"""The subscriptions at a broker without wildcards: each topic separately."""

from collections.abc import Iterable, Iterator, Sequence

from bridge.config.schema import Config, StationConfig
from bridge.mqtt.events import Subscription
from bridge.mqtt.topics import Topics


def plain_subscriptions(
    config: Config, topics: Topics, verbs: Iterable[str]
) -> Sequence[Subscription]:
    """Return the command topics of `config`, the requests `verbs`, and the topics of the bridge."""
    filters = [one.topic_filter for one in topics.subscriptions(config.homeassistant.status_topic)]
    plain = [
        # The topics of the access probe stand in place of its filters.
        *(one.replace("+", "bridge") for one in filters),
        *(topics.request(verb) for verb in verbs),
    ]
    for _, station_config in config.all_stations:
        plain += _commands(station_config, topics)
    plain += (topics.rule_commands(rule.id) for rule in config.rules)
    return [Subscription(topic) for topic in plain]


def _commands(config: StationConfig, topics: Topics) -> Iterator[str]:
    yield f"{topics.snapshot(config.id)}/set"
    for output in config.outputs:
        yield f"{topics.channel(config.id, 'do', output.channel)}/set"
        yield f"{topics.mode(config.id, output.channel)}/set"
        yield f"{topics.hold(config.id, output.channel)}/set"
    for cover in config.covers:
        yield topics.cover_commands(config.id, cover.id)
        yield f"{topics.cover_position(config.id, cover.id)}/set"
