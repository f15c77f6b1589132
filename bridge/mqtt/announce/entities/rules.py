"""The rules of the bridge: a switch each, which turns the rule off and on."""

from collections.abc import Iterable, Iterator

from bridge.config.schema import RuleConfig
from bridge.mqtt.announce.entities.entity import ON_OFF, Entity, availability
from bridge.mqtt.topics import Topics


def entities(topics: Topics, rules: Iterable[RuleConfig]) -> Iterator[Entity]:
    """Yield a switch for each rule; it is on the page of the bridge."""
    for rule in rules:
        options = {
            "name": rule.name,
            "state_topic": topics.rule_state(rule.id),
            "command_topic": topics.rule_commands(rule.id),
            **ON_OFF,
            "optimistic": False,
            "entity_category": "config",
            "qos": 1,
            **availability(topics.bridge_state),
        }
        yield Entity(f"rule_{rule.id}", "switch", options)
