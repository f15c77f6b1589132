"""The client against brokers that are old, strict, broken or silent: scripted ones."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from support.event_log import EventLog, wait_until, warnings_in
from support.scripted_broker import (
    CONNACK_5,
    CONNACK_311,
    CONNECT,
    PUBLISH,
    SUBSCRIBE,
    Script,
    ScriptedBroker,
    suback,
    version_of,
)

from bridge.config.schema import MqttConfig
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

FAST = Backoff(attempt_s=0.3, first_s=0.02, longest_s=0.05)
REFUSED_VERSION_311 = bytes.fromhex("20 02 00 01")
REFUSED_VERSION_5 = bytes.fromhex("20 03 00 84 00")


@contextmanager
def running(
    script: Script, protocol: str = "auto", *, subscribed: bool = True, backoff: Backoff = FAST
) -> Iterator[tuple[ScriptedBroker, MqttClient, EventLog]]:
    """A scripted broker and a client that connects to it."""
    events = EventLog()
    subscriptions = [Subscription("b/+/set"), Subscription("b/ping")] if subscribed else []
    with ScriptedBroker(script) as broker:
        config = MqttConfig("127.0.0.1", broker.port, "b", "bridge-under-test", protocol)
        client = MqttClient(config, subscriptions, events, None, backoff=backoff)
        client.start()
        try:
            yield broker, client, events
        finally:
            client.stop(1)
    assert not client.alive()
    assert client.failure is None


def accepting(kind: int, body: bytes) -> bytes | None:
    """The script of a version 5 broker that grants everything and acknowledges nothing."""
    if kind == CONNECT:
        return CONNACK_5
    return suback(body, 5, 1, 1) if kind == SUBSCRIBE else b""


def old_broker(refusal: bytes | None) -> Script:
    """The script of a broker that knows 3.1.1 alone and refuses 5 this way.

    None closes the connection; an empty answer leaves it open, as amqtt does.
    """

    def script(kind: int, body: bytes) -> bytes | None:
        if kind == CONNECT:
            return refusal if version_of(body) == 5 else CONNACK_311
        return suback(body, 4, 1, 1) if kind == SUBSCRIBE else b""

    return script


@pytest.mark.parametrize(
    ("refusal", "asked"),
    [
        (REFUSED_VERSION_311, [5, 4, 4]),
        (REFUSED_VERSION_5, [5, 4, 4]),
        (None, [5, 4, 5, 4]),
        (b"", [5, 4, 5, 4]),
    ],
    ids=["return code 1", "reason 0x84", "closes", "says nothing"],
)
def test_auto_falls_back_to_311_at_once_and_stays_where_5_was_refused(
    refusal: bytes | None, asked: list[int], caplog: pytest.LogCaptureFixture
) -> None:
    """3.1.1 follows without a pause; where 5 merely got no answer it is tried again each time."""
    with running(old_broker(refusal), backoff=Backoff(attempt_s=0.5, first_s=0.02)) as (
        broker,
        client,
        events,
    ):
        assert events.wait(Connected).protocol == "3.1.1"
        assert warnings_in(caplog) == []
        broker.cut()
        events.wait(Connected, 2)
        assert [version_of(body) for body in broker.bodies(CONNECT)] == asked
        assert client.counters.connections == 2


@pytest.mark.parametrize(("protocol", "version"), [("5", 5), ("3.1.1", 4)])
def test_a_forced_version_is_never_left(
    protocol: str, version: int, caplog: pytest.LogCaptureFixture
) -> None:
    """A refusal is told with the setting's name, and the same version is asked again."""
    with running(lambda _kind, _body: REFUSED_VERSION_311, protocol) as (broker, client, _):
        broker.wait(CONNECT, 3)
        assert {version_of(body) for body in broker.bodies(CONNECT)} == {version}
        assert f"does not take MQTT {protocol}" in str(client.trouble)
        assert "see mqtt.protocol" in caplog.text


def test_a_peer_that_is_no_broker_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    """A peer that is no MQTT broker gives one log line, which asks about TLS."""
    with running(lambda _kind, _body: None) as (broker, _, events):
        broker.wait(CONNECT, 6)
        assert events.all == []
    assert caplog.text.count("takes neither MQTT 5 nor 3.1.1") == 1


@pytest.mark.parametrize("missing", ["CONNACK", "SUBACK"])
def test_a_silent_broker_is_left_at_the_deadline(missing: str) -> None:
    """A peer that accepts and says nothing costs the deadline; then it is tried again."""
    answer = {"CONNACK": b"", "SUBACK": CONNACK_5}[missing]
    with running(lambda kind, _body: answer if kind == CONNECT else b"") as (broker, client, _):
        # Without a CONNACK the other version is asked in between.
        broker.wait(CONNECT, 3 if missing == "CONNACK" else 2)
        assert f"no {missing} within 0.3 s" in str(client.trouble)
        assert not client.connected


def test_a_busy_broker_is_tried_again() -> None:
    """A refusal that is neither of version nor of user is told with its reason."""
    unavailable = bytes.fromhex("20 03 00 88 00")
    with running(lambda _kind, _body: unavailable) as (broker, client, _):
        broker.wait(CONNECT, 2)
        assert "it refused us (Server unavailable)" in str(client.trouble)


def test_a_client_without_subscriptions_is_connected_at_connack() -> None:
    """A client without subscriptions is connected at CONNACK."""
    with running(accepting, subscribed=False) as (broker, _, events):
        events.wait(Connected)
        assert broker.bodies(SUBSCRIBE) == []


def test_connect_asks_for_no_session_and_for_bounded_packets() -> None:
    """Clean start and session expiry 0, at each connection; packets of 256 KiB at most."""
    with running(accepting, "5") as (broker, _, events):
        for count in (1, 2):
            events.wait(Connected, count)
            broker.cut()
        events.wait(Connected, 3)
        for body in broker.bodies(CONNECT):
            assert body[7] & 0x02  # clean start
            assert body[10:21] == bytes.fromhex("0a 11 00000000 27 00040000")
            assert int.from_bytes(body[8:10]) == 14  # keepalive


def test_the_brokers_window_is_kept(caplog: pytest.LogCaptureFixture) -> None:
    """No more messages are on their way than the broker said it takes."""
    receive_maximum_2 = bytes.fromhex("20 06 00 00 03 21 00 02")

    def script(kind: int, body: bytes) -> bytes | None:
        return receive_maximum_2 if kind == CONNECT else accepting(kind, body)

    with running(script) as (broker, client, events):
        events.wait(Connected)
        for n in range(5):
            client.publish(OutMessage("b/state", str(n).encode(), qos=1, retain=False))
        broker.wait(PUBLISH, 2)
        for sent, expected in ((2, 3), (3, 4), (4, 5)):
            assert len(broker.bodies(PUBLISH)) == sent
            mid = broker.bodies(PUBLISH)[sent - 2][9:11]
            broker.send(b"\x40\x02" + mid)
            broker.wait(PUBLISH, expected)
        assert len(events.of(Acknowledged)) == 3
        assert [body[-1:] for body in broker.bodies(PUBLISH)] == [b"0", b"1", b"2", b"3", b"4"]
    assert "failed" not in caplog.text


def test_a_topic_that_is_not_utf8_is_dropped_and_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """No broker should send it; one that does costs us that message alone."""
    with running(accepting) as (broker, client, events):
        events.wait(Connected)
        for _ in range(3):
            broker.send(bytes.fromhex("30 05 0002 ff fe 00"))
        broker.send(bytes.fromhex("30 05 0001 61 00 78"))
        assert events.wait(Received).payload == b"x"
        assert client.counters.undecodable_topics == 3
    assert caplog.text.count("its topic is not UTF-8") == 3  # of one cause 20 an hour are logged


@pytest.mark.parametrize(
    ("reason", "waits"),
    [(0x8E, True), (0x8B, False)],
    ids=["session taken over", "server shutting down"],
)
def test_the_brokers_own_word_decides(reason: int, *, waits: bool) -> None:
    """A DISCONNECT with reason 0x8E means another client; any other reason is a plain loss."""
    with running(accepting) as (broker, client, events):
        events.wait(Connected)
        broker.send(bytes([0xE0, 2, reason, 0]))
        assert events.wait(Disconnected).cause.startswith("it ended the session (")
        if not waits:
            events.wait(Connected, 2)
        assert client.counters.taken_over == int(waits)


def test_nonsense_from_the_broker_ends_the_connection_alone() -> None:
    """Bytes that are no MQTT are a loss with a cause; the next connection is made."""
    with running(accepting) as (broker, _, events):
        events.wait(Connected)
        broker.send(b"\xff\x00")
        assert "Unrecognised command" in events.wait(Disconnected).cause
        events.wait(Connected, 2)


def test_a_black_hole_is_noticed_by_the_keepalive() -> None:
    """A broker that answers no ping is left after two keepalives (here the broker asks for 1 s)."""
    server_keepalive_1 = bytes.fromhex("20 06 00 00 03 13 00 01")

    def script(kind: int, body: bytes) -> bytes | None:
        return server_keepalive_1 if kind == CONNECT else accepting(kind, body)

    with running(script) as (_, _, events):
        began = events.wait(Connected).at
        lost = events.wait(Disconnected)
    assert lost.cause == "Keep alive timeout"
    assert lost.at - began < 10


def test_a_host_that_is_no_name_is_unreachable() -> None:
    """A host that is not a valid name is reported as unreachable."""
    config = MqttConfig("no..name", 1883, "b", "bridge-under-test", "auto")
    client = MqttClient(config, [], EventLog(), None)
    client.start()
    try:
        wait_until(lambda: client.trouble is not None)
    finally:
        client.stop(1)
    assert "no connection to the broker at no..name:1883" in str(client.trouble)


def test_a_message_offered_while_the_connection_ends_is_not_taken() -> None:
    """Between an end and its event nothing is accepted any more."""
    taken: list[int | None] = []
    events = EventLog()
    client: MqttClient

    def emit(event: object) -> None:
        if isinstance(event, Disconnected):
            taken.append(client.publish(OutMessage("b/state", b"ON", qos=1, retain=False)))
        events(event)  # type: ignore[arg-type]  # it is one of them

    with ScriptedBroker(accepting) as broker:
        config = MqttConfig("127.0.0.1", broker.port, "b", "bridge-under-test", "5")
        client = MqttClient(config, [], emit, None, backoff=FAST)
        client.start()
        events.wait(Connected)
        broker.cut()
        events.wait(Disconnected)
        client.stop(1)
    assert taken[0] is None
