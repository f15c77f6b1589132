"""The switch of a rule in Home Assistant."""

from support.entities import of_bridge
from support.rules import rule

STAIRS = rule("garage/di/1", "ON", {"garage/do/1": "ON"})


def test_each_rule_is_a_setting_of_the_bridge() -> None:
    """It is available while the bridge is: a module that is away does not matter."""
    switch = of_bridge(STAIRS)["rule_stairs_switch"]
    assert switch == {
        "name": "Stairs",
        "state_topic": "wisco/bridge/rule/stairs/state",
        "command_topic": "wisco/bridge/rule/stairs/set",
        "payload_on": "ON",
        "payload_off": "OFF",
        "optimistic": False,
        "entity_category": "config",
        "qos": 1,
        "availability": [{"topic": "wisco/bridge/state"}],
        "availability_mode": "all",
    }
