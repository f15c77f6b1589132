from support.mqtt_side import CONFIG

from bridge.mqtt.plain import plain_subscriptions
from bridge.mqtt.topics import CommandTarget, CoverTarget, Topics


def test_every_command_topic_of_the_configuration_is_there() -> None:
    """No wildcard, no topic twice, and each output with its settings."""
    topics = Topics("wisco")
    plain = [one.topic_filter for one in plain_subscriptions(CONFIG, topics, ["purge"])]
    assert len(plain) == len(set(plain))
    assert not any("+" in topic for topic in plain)
    assert {"wisco/garage/set", "wisco/garage/do/4/set", "wisco/attic/do/16/mode/set"} <= set(plain)
    assert {"wisco/bridge/ping", "wisco/bridge/state", "homeassistant/status"} <= set(plain)
    assert "wisco/bridge/request/purge" in plain
    stations = [
        target.station_id
        for target in map(topics.parse, plain)
        if isinstance(target, CommandTarget | CoverTarget) and target.station_id != "bridge"
    ]
    assert len(stations) == 2 + 3 * 4
