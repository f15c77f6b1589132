"""The client against a real mosquitto."""

import random
import time

import pytest
from support.event_log import EventLog, wait_until, warnings_in
from support.mosquitto import Mosquitto, free_port
from support.mqtt_probe import MqttProbe
from support.running_client import COMMANDS, FAST, both_versions, config_for, message, running

from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import (
    Acknowledged,
    Connected,
    Disconnected,
    OutMessage,
    Received,
    Subscription,
)
from bridge.mqtt.reconnect import Backoff

pytestmark = pytest.mark.warns  # what goes wrong here is logged


@both_versions
def test_it_connects_publishes_and_receives(mosquitto: Mosquitto, protocol: str) -> None:
    """Connected names the protocol; a message is acknowledged, and a command arrives."""
    with (
        MqttProbe(mosquitto.port, "b/#") as probe,
        running(config_for(mosquitto.port, protocol)) as (client, events),
    ):
        assert events.wait(Connected).protocol == protocol
        assert client.connected
        token = client.publish(message("ON", retain=True))
        assert events.wait(Acknowledged).token == token
        assert probe.wait_message("b/state", "ON").retain
        before = time.monotonic()
        probe.publish("b/garage/set", b"\xff\x00")
        received = events.wait(Received)
        assert (received.topic, received.payload) == ("b/garage/set", b"\xff\x00")
        assert before <= received.at <= time.monotonic()
        assert not received.retain


def test_messages_keep_their_order_past_the_window(mosquitto: Mosquitto) -> None:
    """More messages than fit the window arrive all, once and in order."""
    count = 200
    with (
        MqttProbe(mosquitto.port, "b/#") as probe,
        running(config_for(mosquitto.port)) as (client, events),
    ):
        events.wait(Connected)
        tokens = [client.publish(message(str(n))) for n in range(count)]
        seen = probe.wait_for(lambda messages: len(messages) >= count)
        assert [one.text for one in seen] == [str(n) for n in range(count)]
        events.wait(Acknowledged, count)
        assert [one.token for one in events.of(Acknowledged)] == tokens


def test_a_message_of_qos_0_is_not_acknowledged(mosquitto: Mosquitto) -> None:
    """A QoS 0 message arrives; only the QoS 1 message after it is acknowledged."""
    with (
        MqttProbe(mosquitto.port, "b/#") as probe,
        running(config_for(mosquitto.port)) as (client, events),
    ):
        events.wait(Connected)
        client.publish(message("0", qos=0))
        token = client.publish(message("1"))
        probe.wait_message("b/state", "1")
        assert [one.text for one in probe.seen] == ["0", "1"]
        assert events.wait(Acknowledged).token == token


def test_nothing_is_taken_while_there_is_no_connection() -> None:
    """Publishing without a broker says so, and neither waits nor raises."""
    with running(config_for(free_port())) as (client, events):
        assert client.publish(message("ON")) is None
        assert not client.connected
        assert events.all == []


def test_it_waits_for_a_broker_that_comes_later(
    mosquitto: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """An absent broker is told once, and the client connects when it comes."""
    mosquitto.stop()
    steps = Backoff(first_s=0.01, longest_s=0.01)
    with running(config_for(mosquitto.port), backoff=steps) as (client, events):
        wait_until(lambda: client.trouble is not None)
        began = time.monotonic()
        wait_until(lambda: time.monotonic() > began + 0.1)  # several attempts later
        mosquitto.start()
        events.wait(Connected)
        assert client.trouble is None
    [warning] = warnings_in(caplog)
    assert f"127.0.0.1:{mosquitto.port}: [Errno 111] Connection refused" in warning


def test_it_is_back_after_the_broker_restarts(mosquitto: Mosquitto) -> None:
    """The subscription works again each time, and no other client is blamed."""
    with running(config_for(mosquitto.port)) as (client, events):
        for round_ in range(1, 6):
            events.wait(Connected, round_)
            with MqttProbe(mosquitto.port) as probe:
                probe.publish("b/garage/set", str(round_))
                assert events.wait(Received, round_).payload == str(round_).encode()
            mosquitto.stop()
            events.wait(Disconnected, round_)
            assert client.publish(message("lost")) is None
            mosquitto.start()
        assert client.counters.taken_over == 0


@pytest.mark.parametrize(
    ("protocol", "taken"),
    [("5", [(b"live", False)]), ("3.1.1", [(b"ON", True), (b"live", False)])],
)
def test_a_retained_command_is_kept_back_or_marked(
    mosquitto: Mosquitto, protocol: str, taken: list[tuple[bytes, bool]]
) -> None:
    """On 5 retain handling 2 keeps it back; on 3.1.1 its flag tells it from a live command."""
    with MqttProbe(mosquitto.port) as probe:
        probe.publish("b/garage/set", "ON", retain=True)
        with running(config_for(mosquitto.port, protocol)) as (_, events):
            events.wait(Connected)
            probe.publish("b/other/set", "live")
            events.wait(Received, len(taken))
            assert [(one.payload, one.retain) for one in events.of(Received)] == taken


def test_a_live_command_with_the_retain_flag_is_marked_on_version_5(mosquitto: Mosquitto) -> None:
    """Retain as published: the publisher's flag arrives, so that it can be refused."""
    with (
        MqttProbe(mosquitto.port) as probe,
        running(config_for(mosquitto.port, "5")) as (_, events),
    ):
        events.wait(Connected)
        probe.publish("b/garage/set", "ON", retain=True)
        assert events.wait(Received).retain


def test_what_is_retained_arrives_where_it_is_wanted(mosquitto: Mosquitto) -> None:
    """A subscription that is not live only gets the stored copy, marked as retained."""
    wanted = Subscription("b/state", live_only=False, as_published=False)
    with MqttProbe(mosquitto.port) as probe:
        probe.publish("b/state", "old", retain=True)
        with running(config_for(mosquitto.port, "5"), wanted) as (_, events):
            events.wait(Received)
            probe.publish("b/state", "new", retain=True)
            events.wait(Received, 2)
            flags = [(one.payload, one.retain) for one in events.of(Received)]
            assert flags == [(b"old", True), (b"new", False)]


def test_version_5_properties_cross_in_both_directions(mosquitto: Mosquitto) -> None:
    """Response topic, correlation data and expiry of a command arrive, and ours go out."""
    with (
        MqttProbe(mosquitto.port, "reply/#") as probe,
        running(config_for(mosquitto.port, "5")) as (client, events),
    ):
        events.wait(Connected)
        probe.publish(
            "b/garage/set", "ON", response_topic="reply/1", correlation=b"\x00\x01", expiry_s=60
        )
        received = events.wait(Received)
        assert received.response_topic == "reply/1"
        assert received.correlation == b"\x00\x01"
        assert received.expiry_s is not None
        assert 58 <= received.expiry_s <= 60
        client.publish(message("done", topic="reply/1", correlation=b"\x00\x01"))
        assert probe.wait_message("reply/1", "done").correlation == b"\x00\x01"


def test_a_message_expires_in_the_broker(mosquitto: Mosquitto) -> None:
    """The expiry interval of an outgoing message reaches the broker: its copy goes away."""
    with running(config_for(mosquitto.port, "5")) as (client, events):
        events.wait(Connected)
        client.publish(message("brief", retain=True, expiry_s=1))
        client.publish(message("kept", topic="b/kept", retain=True))
        events.wait(Acknowledged, 2)

        def gone() -> bool:
            with MqttProbe(mosquitto.port, "b/#") as probe:
                probe.wait_message("b/kept")
                return [one.text for one in probe.seen] == ["kept"]

        wait_until(gone)


def test_version_5_properties_fall_away_on_version_311(mosquitto: Mosquitto) -> None:
    """On 3.1.1 a message is sent without its MQTT 5 properties."""
    with (
        MqttProbe(mosquitto.port, "b/state") as probe,
        running(config_for(mosquitto.port, "3.1.1")) as (client, events),
    ):
        events.wait(Connected)
        client.publish(message("ON", correlation=b"1", expiry_s=5))
        assert probe.wait_message("b/state", "ON").correlation is None


def test_a_topic_that_mqtt_does_not_allow_is_named_and_counts_as_answered(
    mosquitto: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """A wildcard in a topic costs one message and not the connection."""
    with running(config_for(mosquitto.port)) as (client, events):
        events.wait(Connected)
        client.publish(message("1", topic="b/#", qos=0))
        token = client.publish(message("1", topic="b/+"))
        assert events.wait(Acknowledged).token == token
        assert client.connected
    assert any("'b/+'" in line for line in warnings_in(caplog))


@pytest.mark.parametrize("protocol", ["5", "3.1.1"])
def test_a_message_that_is_too_large_is_cut_or_never_sent(
    mosquitto: Mosquitto, protocol: str, caplog: pytest.LogCaptureFixture
) -> None:
    """On 3.1.1 its beginning arrives and it is acknowledged; on 5 the broker keeps it back."""
    with (
        MqttProbe(mosquitto.port) as probe,
        running(config_for(mosquitto.port, protocol)) as (client, events),
    ):
        events.wait(Connected)
        for _ in range(3):
            probe.publish("b/garage/set", b"x" * 5_000_000)
        probe.publish("b/garage/set", b"last")
        events.wait_for(
            lambda: b"last" in [one.payload for one in events.of(Received)], "the last message"
        )
        sizes = [len(one.payload) for one in events.of(Received)]
        assert sizes == ([8192] * 3 + [4] if protocol == "3.1.1" else [4])
        assert client.connected
        assert client.counters.connections == 1
    named = [line for line in warnings_in(caplog) if "was not read" in line]
    assert len(named) == (3 if protocol == "3.1.1" else 0)


def test_fuzzed_messages_do_not_kill_the_thread(mosquitto: Mosquitto) -> None:
    """1,000 random topics and payloads all arrive as they are, byte for byte."""
    chance = random.Random(20)  # noqa: S311  # a test repeats itself
    alphabet = "abc/é☃😀 \"'%{}[]\\$"
    sent: list[tuple[str, bytes]] = []
    with (
        MqttProbe(mosquitto.port) as probe,
        running(config_for(mosquitto.port), Subscription("b/#")) as (client, events),
    ):
        events.wait(Connected)
        for _ in range(1000):
            topic = "b/" + "".join(chance.choices(alphabet, k=chance.randrange(1, 30)))
            payload = chance.randbytes(chance.randrange(60))
            sent.append((topic, payload))
            probe.publish(topic, payload, qos=chance.choice((0, 1)))
        events.wait(Received, len(sent))
        assert sorted((one.topic, one.payload) for one in events.of(Received)) == sorted(sent)
        assert client.alive()


def test_a_flood_waits_at_its_sender(mosquitto: Mosquitto) -> None:
    """While more is to be handled than can be, nothing is read; then everything comes."""
    events = EventLog()
    backlog = 0
    client = MqttClient(
        config_for(mosquitto.port), [COMMANDS], events, None, backoff=FAST, backlog=lambda: backlog
    )
    client.start()
    try:
        events.wait(Connected)
        backlog = 20_000
        # It looks again when it has written: from then on it goes by the backlog.
        client.publish(OutMessage("b/other", b"", qos=0, retain=False))
        with MqttProbe(mosquitto.port, "b/other") as probe:
            client.publish(OutMessage("b/other", b"x", qos=0, retain=False))
            probe.wait_message("b/other", "x")
            for number in range(100):
                probe.publish("b/garage/set", f"{number}")
            client.publish(OutMessage("b/other", b"y", qos=0, retain=False))
            probe.wait_message("b/other", "y")  # it still writes
            assert events.of(Received) == []
            backlog = 0
            wait_until(lambda: len(events.of(Received)) == 100)
    finally:
        client.stop(10)
