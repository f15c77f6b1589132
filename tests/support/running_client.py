"""A client under test, and what it emits."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from support.event_log import EventLog
from support.mosquitto import Mosquitto

from bridge.config.schema import MqttConfig
from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import (
    OutMessage,
    Subscription,
)
from bridge.mqtt.reconnect import Backoff

FAST = Backoff(attempt_s=5, first_s=0.02, longest_s=0.1, taken_over_s=60)
COMMANDS = Subscription("b/+/set")
MakeMosquitto = Callable[..., Mosquitto]
both_versions = pytest.mark.parametrize("protocol", ["5", "3.1.1"])


def config_for(port: int, protocol: str = "auto") -> MqttConfig:
    """The configuration of a client at a loopback broker."""
    return MqttConfig("127.0.0.1", port, "b", "bridge-under-test", protocol)


def message(payload: str, topic: str = "b/state", **fields: bool | bytes | int) -> OutMessage:
    """A message of QoS 1, retained only where that is asked."""
    plain = OutMessage(topic, payload.encode(), qos=1, retain=False)
    return replace(plain, **fields)  # type: ignore[arg-type]  # each field has its own type


@contextmanager
def running(
    config: MqttConfig,
    *subscriptions: Subscription,
    will: OutMessage | None = None,
    backoff: Backoff = FAST,
) -> Iterator[tuple[MqttClient, EventLog]]:
    """A started client and what it emits; stopped in the end, with its thread gone."""
    events = EventLog()
    client = MqttClient(config, subscriptions or [COMMANDS], events, will, backoff=backoff)
    client.start()
    try:
        yield client, events
    finally:
        client.stop(10)
    assert not client.alive()
    assert client.failure is None
