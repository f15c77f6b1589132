"""The client against brokers that allow little, and say so or just close: scripted ones."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest
from support.event_log import EventLog, warnings_in
from support.scripted_broker import CONNECT, PUBLISH, SUBSCRIBE
from support.strict_broker import Allows, StrictBroker

from bridge.config.schema import MqttConfig
from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import Acknowledged, Connected, OutMessage, Subscribed, Subscription
from bridge.mqtt.reconnect import Backoff

pytestmark = pytest.mark.warns  # what goes wrong here is logged

FAST = Backoff(attempt_s=5.0, first_s=0.02, longest_s=0.05)
MANY = [Subscription(f"b/{n}/set") for n in range(25)]
WILL = OutMessage("b/bridge/state", b"offline", qos=1, retain=True)


@contextmanager
def connected(
    allows: Allows,
    protocol: str = "5",
    subscriptions: Sequence[Subscription] = (Subscription("b/+/set"),),
    plain: Sequence[Subscription] = (),
    command_qos: int = 1,
) -> Iterator[tuple[StrictBroker, MqttClient, EventLog]]:
    """A broker that allows this, and a client that is connected to it."""
    events = EventLog()
    with StrictBroker(allows) as broker:
        config = MqttConfig(
            "127.0.0.1",
            broker.port,
            "b",
            "bridge-under-test",
            protocol,
            command_qos=command_qos,
        )
        client = MqttClient(config, subscriptions, events, WILL, backoff=FAST, plain=lambda: plain)
        client.start()
        try:
            events.wait(Connected)
            yield broker, client, events
        finally:
            client.stop(1)
    assert client.failure is None


def state(topic: str, payload: bytes = b"ON") -> OutMessage:
    """A retained message."""
    return OutMessage(topic, payload, qos=1, retain=True)


@pytest.mark.parametrize("protocol", ["5", "3.1.1"])
@pytest.mark.parametrize("filters", [1, 3, 7, 8, 100])
def test_it_is_ready_however_few_filters_a_packet_may_have(protocol: str, filters: int) -> None:
    """The client becomes ready for any limit of filters in a SUBSCRIBE packet."""
    with connected(Allows(filters=filters), protocol, MANY) as (broker, client, _):
        assert broker.filters[-25:] == [one.topic_filter for one in MANY]
        asked = [len(body) for body in broker.bodies(SUBSCRIBE)]
        assert len(asked) >= 25 // min(8, filters)
        assert client.counters.taken_over == 0


def test_a_close_before_suback_is_named_as_what_it_is(caplog: pytest.LogCaptureFixture) -> None:
    """Repeated closes before SUBACK are not taken for another client with our id."""
    with connected(Allows(filters=1), "5", MANY) as (broker, client, _):
        assert broker.connects == 4  # 8, 4, 2 filters, then 1
        assert client.counters.taken_over == 0
    assert any("before it answered SUBSCRIBE with 8 filters" in w for w in warnings_in(caplog))
    assert not any("another client" in line for line in warnings_in(caplog))


def test_later_subscriptions_are_split_as_well_and_answered_once() -> None:
    """Packets of 8 at most; `Subscribed` follows the last."""
    with connected(Allows(filters=8)) as (broker, client, events):
        client.subscribe(MANY)
        events.wait(Subscribed)
        assert broker.filters[1:] == [one.topic_filter for one in MANY]
        client.unsubscribe([one.topic_filter for one in MANY])
        assert len(events.of(Subscribed)) == 1


@pytest.mark.parametrize("says", [True, False])
def test_without_wildcards_each_topic_is_subscribed_by_itself(
    caplog: pytest.LogCaptureFixture, *, says: bool
) -> None:
    """Without wildcards each topic is subscribed separately; surveys count as denied."""
    with connected(Allows(wildcards=False, says=says), plain=MANY) as (broker, client, events):
        assert broker.filters == [one.topic_filter for one in MANY]
        client.subscribe([Subscription("b/+/state"), Subscription("b/x")])
        assert events.wait(Subscribed).denied == ("b/+/state",)
        assert broker.filters == [*(one.topic_filter for one in MANY), "b/x"]
    assert sum("allows no wildcards" in line for line in warnings_in(caplog)) == 1


def test_without_qos_1_messages_go_with_qos_0_and_count_as_acknowledged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The last will too: the broker would refuse CONNECT because of it."""
    with connected(Allows(qos=0)) as (broker, client, events):
        tokens = [client.publish(state(f"b/{n}")) for n in range(5)]
        events.wait(Acknowledged, 5)
        assert [one.token for one in events.of(Acknowledged)] == tokens
        broker.wait(PUBLISH, 5)
        assert broker.messages == dict.fromkeys([f"b/{n}" for n in range(5)], b"ON")
    assert sum("takes QoS 0 alone" in line for line in warnings_in(caplog)) == 1


@pytest.mark.parametrize("protocol", ["5", "3.1.1"])
@pytest.mark.parametrize("command_qos", [0, 1])
def test_it_subscribes_with_the_qos_of_the_configuration(protocol: str, command_qos: int) -> None:
    """`mqtt.command_qos`: the last byte of a SUBSCRIBE has the QoS of its last filter."""
    with connected(Allows(), protocol, command_qos=command_qos) as (broker, client, events):
        client.publish(state("b/1"))
        events.wait(Acknowledged)
        assert {body[-1] & 3 for body in broker.bodies(SUBSCRIBE)} == {command_qos}


def test_without_retained_messages_states_are_told_all_the_same(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Without retained messages, states are sent without the flag, and clears are left out."""
    with connected(Allows(retain=False)) as (broker, client, events):
        client.publish(state("b/cleared", b""))
        client.publish(state("b/1"))
        events.wait(Acknowledged, 2)
        assert broker.messages == {"b/1": b"ON"}
        assert broker.bodies(CONNECT)[-1][7] >> 5 & 1 == 0  # will retain
    assert sum("keeps no retained messages" in line for line in warnings_in(caplog)) >= 1


def test_what_is_too_large_for_the_broker_is_left_out_and_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A message longer than the limit in CONNACK is left out, and named once."""
    with connected(Allows(packet_bytes=2048)) as (broker, client, events):
        for _ in range(3):
            client.publish(state("b/large", b"x" * 5000))
        client.publish(state("b/small"))
        events.wait(Acknowledged, 4)
        assert (broker.messages, broker.connects) == ({"b/small": b"ON"}, 1)
        assert client.counters.failed_publishes == 3
    [line] = warnings_in(caplog)
    assert "5015 bytes to 'b/large'" in line
    assert "homeassistant.discovery to single" in line


@pytest.mark.parametrize("protocol", ["5", "3.1.1"])
def test_a_message_that_cuts_the_connection_twice_is_left_out(
    protocol: str, caplog: pytest.LogCaptureFixture
) -> None:
    """A broker that has no word for its limit: the next connection leaves nothing to be cut for."""
    allows = Allows(packet_bytes=2048, says=False)
    with connected(allows, protocol) as (broker, client, events):
        for count in range(1, 6):
            events.wait(Connected, min(count, 3))
            client.publish(state("b/small"))
            client.publish(state("b/large", b"x" * 5000))
            client.publish(state("b/larger", b"x" * 6000))
            client.publish(state("b/last"))
            if count <= 2:
                events.wait(Connected, count + 1)
        events.wait_for(lambda: "b/last" in broker.messages, "b/last")
        assert (broker.connects, set(broker.messages)) == (3, {"b/small", "b/last"})
        assert client.counters.taken_over == 0
    lines = warnings_in(caplog)
    assert sum("left out" in line and "'b/large'" in line for line in lines) == 1
    assert sum("left out" in line and "'b/larger'" in line for line in lines) == 1


def test_a_broker_that_names_the_reason_cuts_once() -> None:
    """DISCONNECT with `Packet too large` needs no second proof."""
    with connected(Allows(packet_bytes=2048, says=False)) as (broker, client, events):
        broker._allows = Allows(packet_bytes=2048)  # it says why it closes
        client.publish(state("b/large", b"x" * 5000))
        events.wait(Connected, 2)
        client.publish(state("b/large", b"x" * 5000))
        client.publish(state("b/small"))
        events.wait(Acknowledged, 2)
        assert broker.connects == 2


def test_a_large_message_of_qos_0_is_found_out_too() -> None:
    """An untried large QoS 0 message is sent with QoS 1."""
    with connected(Allows(packet_bytes=2048, says=False), "3.1.1") as (broker, client, events):
        large = OutMessage("b/large", b"x" * 5000, qos=0, retain=True)
        for count in (2, 3):
            client.publish(large)
            events.wait(Connected, count)
        client.publish(large)
        client.publish(state("b/small"))
        events.wait(Acknowledged)
        time.sleep(0.1)  # it would be cut by now
        assert (broker.connects, broker.messages) == (3, {"b/small": b"ON"})


def test_a_keepalive_of_hours_does_not_hide_a_black_hole() -> None:
    """The broker may allow more than we ask for: we ask as often as we meant to."""
    with connected(Allows()) as (_, client, _events):
        assert client._connection is not None
        paho = client._connection._wire._paho
        paho._keepalive = 3600
        paho.keep_our_keepalive()
        assert paho._keepalive == 14
        paho._keepalive = 0
        paho.keep_our_keepalive()
        assert paho._keepalive == 14
