"""The connection of a command to a broker."""

from support.scripted_broker import CONNACK_5, CONNECT, SUBSCRIBE, ScriptedBroker, suback

from bridge.cli.through_broker.broker import at_broker
from bridge.config.schema import MqttConfig
from bridge.mqtt.events import Subscription

_MOST_FILTERS = 2


def _few(kind: int, body: bytes) -> bytes | None:
    """Close the connection over a SUBSCRIBE with more than two filters, and answer others."""
    if kind == CONNECT:
        return CONNACK_5
    if kind == SUBSCRIBE:
        filters = body.count(b"topic/")
        return suback(body, 5, *[1] * filters) if filters <= _MOST_FILTERS else None
    return b""


def test_a_broker_that_takes_few_filters_at_once_is_asked_for_fewer() -> None:
    """A command does not give up where the bridge itself would go on."""
    wanted = [Subscription(f"topic/{n}", live_only=False) for n in range(8)]
    with ScriptedBroker(_few) as broker:
        config = MqttConfig("127.0.0.1", broker.port, "b", "bridge-under-test", "5")
        with at_broker(config, "test", wanted, 10.0):
            asked = broker.bodies(SUBSCRIBE)
        assert asked[0].count(b"topic/") == 8
        assert sum(body.count(b"topic/") for body in asked) > 8
