"""The client against a real mosquitto."""

import logging
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import pytest
from support.certificates import make_authority
from support.event_log import EventLog, wait_until, warnings_in
from support.mosquitto import Mosquitto, free_port
from support.mqtt_probe import MqttProbe
from support.tcp_relay import TcpRelay

from bridge.config.schema import MqttConfig, Server, TlsConfig
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

FAST = Backoff(attempt_s=5, first_s=0.02, longest_s=0.1, taken_over_s=60)
COMMANDS = Subscription("b/+/set")
MakeMosquitto = Callable[..., Mosquitto]


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


both_versions = pytest.mark.parametrize("protocol", ["5", "3.1.1"])


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


def test_a_denied_publish_is_named_once_and_counts_as_answered(
    make_mosquitto: MakeMosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """The reason code of a PUBACK is read: the log has topic and reason, once a connection."""
    acl = "topic read b/#\ntopic write b/mine\n"
    broker = make_mosquitto(acl=acl)
    with running(config_for(broker.port, "5")) as (client, events):
        events.wait(Connected)
        tokens = [client.publish(message("secret-payload", topic="b/theirs")) for _ in range(3)]
        tokens.append(client.publish(message("secret-payload", topic="b/mine")))
        events.wait(Acknowledged, 4)
        assert [one.token for one in events.of(Acknowledged)] == tokens
        assert client.counters.failed_publishes == 3
    assert warnings_in(caplog) == [
        "the broker did not take a message to 'b/theirs': Not authorized; check its access list"
    ]
    assert "secret-payload" not in caplog.text


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


def test_a_denied_subscription_is_named_in_the_log(
    make_mosquitto: MakeMosquitto, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A SUBACK that refuses a filter is told once, over reconnects too; the rest works."""
    plugins = sorted(Path("/usr/lib").glob("**/mosquitto_dynamic_security.so"))
    if not plugins:
        pytest.skip("mosquitto's dynamic security plugin is not installed")
    rules = tmp_path / "rules.json"
    rules.write_text(DENY_B)
    options = [f"plugin {plugins[0]}", f"plugin_opt_config_file {rules}"]
    broker = make_mosquitto(options=options)
    allowed = Subscription("allowed/#")
    with running(config_for(broker.port, "5"), COMMANDS, allowed) as (client, events):
        events.wait(Connected)
        broker.restart()
        events.wait(Connected, 2)
        client.publish(message("hello", topic="allowed/1"))
        assert events.wait(Received).topic == "allowed/1"
    assert [line for line in warnings_in(caplog) if "denies" in line] == [
        "the broker denies the subscription to b/+/set: Not authorized; check its access list"
    ]


DENY_B = """{
  "defaultACLAccess": {
    "publishClientSend": true, "publishClientReceive": true,
    "subscribe": false, "unsubscribe": true
  },
  "clients": [],
  "groups": [{"groupname": "all", "roles": [{"rolename": "all"}], "clients": []}],
  "roles": [{"rolename": "all",
    "acls": [{"acltype": "subscribePattern", "topic": "allowed/#", "allow": true}]}],
  "anonymousGroup": "all"
}"""


@both_versions
def test_a_wrong_password_says_what_to_do(
    make_mosquitto: MakeMosquitto, caplog: pytest.LogCaptureFixture, protocol: str
) -> None:
    """The log names user and settings, never the password; right ones connect."""
    broker = make_mosquitto(users={"wisco": "right"})
    config = replace(config_for(broker.port, protocol), username="wisco", password="wrong-one")  # noqa: S106  # the test's own
    with running(config) as (client, events):
        wait_until(lambda: client.trouble is not None)
        assert events.all == []
    assert "refuses user 'wisco'" in caplog.text
    assert "check mqtt.username and mqtt.password" in caplog.text
    assert "wrong-one" not in caplog.text
    with running(replace(config, password="right")) as (_, events):  # noqa: S106  # the test's own
        events.wait(Connected)


def test_tls_with_the_right_authority_connects(make_mosquitto: MakeMosquitto) -> None:
    """The broker's certificate is verified, and large messages cross TLS whole."""
    broker = make_mosquitto(tls=True)
    assert broker.tls_port is not None
    config = replace(
        config_for(broker.tls_port), host="localhost", tls=TlsConfig(ca=broker.directory / "ca.crt")
    )
    with MqttProbe(broker.port) as probe, running(config) as (_, events):
        events.wait(Connected)
        probe.publish("b/garage/set", b"x" * 250_000)
        for n in range(20):
            probe.publish("b/garage/set", str(n))
        assert len(events.wait(Received).payload) == 250_000
        assert events.wait(Received, 21).payload == b"19"


def test_a_client_certificate_is_shown(make_mosquitto: MakeMosquitto) -> None:
    """A broker that asks for a certificate gets the configured one."""
    broker = make_mosquitto(tls=True, options=["require_certificate true"])
    assert broker.tls_port is not None
    here = broker.directory
    tls = TlsConfig(here / "ca.crt", here / "client.crt", here / "client.key")
    config = replace(config_for(broker.tls_port), host="localhost", tls=tls)
    with running(config) as (_, events):
        events.wait(Connected)


# paho leaves the socket of a failed handshake to its finaliser, which closes it and says so.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")
@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        ("authority", "certificate verify failed"),
        ("name", "certificate is not valid for '127.1'"),
        ("file", "No such file"),
    ],
)
def test_tls_that_does_not_verify_is_refused(
    make_mosquitto: MakeMosquitto, tmp_path: Path, wrong: str, cause: str
) -> None:
    """Another authority, another name, or a file that is not there: no connection."""
    broker = make_mosquitto(tls=True)
    assert broker.tls_port is not None
    make_authority(tmp_path)
    authority = {
        "authority": tmp_path / "ca.crt",
        "name": broker.directory / "ca.crt",
        "file": tmp_path / "no such file",
    }[wrong]
    # 127.1 is how the resolver abbreviates 127.0.0.1; no certificate names it.
    host = "127.1" if wrong == "name" else "localhost"
    config = replace(config_for(broker.tls_port), host=host, tls=TlsConfig(ca=authority))
    with running(config) as (client, events):
        wait_until(lambda: client.trouble is not None)
        assert cause in str(client.trouble)
        assert events.all == []


def test_the_will_is_published_when_the_link_breaks(mosquitto: Mosquitto) -> None:
    """A reset without DISCONNECT makes the broker publish our will, retained."""
    will = OutMessage("b/bridge/state", b"offline", qos=1, retain=True)
    with (
        MqttProbe(mosquitto.port, "b/#") as probe,
        TcpRelay(mosquitto.port) as relay,
        running(config_for(relay.port), will=will) as (_, events),
    ):
        events.wait(Connected)
        relay.cut()
        assert probe.wait_message("b/bridge/state", "offline").retain
        events.wait(Connected, 2)


def test_a_stop_publishes_no_will_and_loses_nothing(mosquitto: Mosquitto) -> None:
    """`stop` delivers what was published, and DISCONNECT prevents the last will."""
    will = OutMessage("b/bridge/state", b"will", qos=1, retain=True)
    with MqttProbe(mosquitto.port, "b/#") as probe:
        with running(config_for(mosquitto.port), will=will) as (client, events):
            events.wait(Connected)
            for n in range(300):
                client.publish(message(str(n)))
        probe.publish("b/last", "")
        probe.wait_message("b/last")
        assert [one.text for one in probe.seen[:-1]] == [str(n) for n in range(300)]
        assert events.of(Disconnected)[-1].cause == "stopped"


def test_nothing_of_an_old_connection_is_sent_by_the_new_one(mosquitto: Mosquitto) -> None:
    """Messages that a cut connection had not delivered are not sent by the next one."""
    with (
        MqttProbe(mosquitto.port, "b/#") as probe,
        TcpRelay(mosquitto.port) as relay,
        running(config_for(relay.port)) as (client, events),
    ):
        events.wait(Connected)
        relay.stall()
        for n in range(250):  # some in flight, some beyond the window
            assert client.publish(message(f"old {n}")) is not None
        relay.cut()
        events.wait(Disconnected)
        relay.resume()
        events.wait(Connected, 2)
        client.publish(message("new"))
        probe.wait_message("b/state", "new")
        events.wait(Acknowledged)
        assert [one.text for one in probe.seen] == ["new"]
        assert len(events.of(Acknowledged)) == 1


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


@both_versions
def test_a_client_with_the_same_id_is_named_and_given_way_to(
    mosquitto: Mosquitto, caplog: pytest.LogCaptureFixture, protocol: str
) -> None:
    """Two clients with one id: the log says why, and soon one of them gives way for a while."""
    config = config_for(mosquitto.port, protocol)
    with running(config) as (first, _), running(config) as (second, _):
        wait_until(lambda: bool(first.counters.taken_over + second.counters.taken_over))
        loser, winner = (first, second) if first.counters.taken_over else (second, first)
        paused = time.monotonic()
        wait_until(lambda: paused < loser.progress < time.monotonic())  # it gives signs of life
        assert winner.connected
        assert not loser.connected
        # Three hang-ups in a row tell, where the broker does not say it.
        assert loser.counters.connections <= 3
    end = "stop it or set mqtt.client_id; waiting 60 s"
    named = [line for line in warnings_in(caplog) if "client id 'bridge-under-test'" in line]
    assert [line[-len(end) :] for line in named] == [end]


def test_a_slow_connect_is_no_missing_sign_of_life(monkeypatch: pytest.MonkeyPatch) -> None:
    """A resolver that hangs is no stuck thread: a watchdog gives it a minute. `stop` waits 1 s."""
    looked_up, released = threading.Event(), threading.Event()

    def hang(*_: object, **_options: object) -> NoReturn:
        looked_up.set()
        released.wait(30)
        raise OSError("no network")

    monkeypatch.setattr(socket, "getaddrinfo", hang)
    client = MqttClient(config_for(free_port()), [COMMANDS], EventLog(), None)
    client.start()
    assert looked_up.wait(20)
    assert client.progress > time.monotonic() + 25
    began = time.monotonic()
    client.stop(10)
    assert 0.5 < time.monotonic() - began < 3
    released.set()
    wait_until(lambda: not client.alive())
    assert client.failure is None


def cluster(*ports: int) -> MqttConfig:
    """The configuration of a client at a broker with several servers, all on loopback."""
    first, *others = (Server("127.0.0.1", port) for port in ports)
    return replace(config_for(first.port), others=tuple(others))


@contextmanager
def mute_server() -> Iterator[int]:
    """A server that takes connections and never says a word."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_of_several_servers_the_one_that_works_is_found(mosquitto: Mosquitto) -> None:
    """One is off, one takes connections and is mute, the third takes us, without a pause."""
    patient = replace(FAST, attempt_s=0.3, first_s=30, longest_s=60)
    with (
        mute_server() as mute,
        running(cluster(free_port(), mute, mosquitto.port), backoff=patient) as (_, events),
    ):
        events.wait(Connected)


def test_after_a_loss_the_next_server_is_tried(
    make_mosquitto: MakeMosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """The first server is killed: the second has us after one pause, with one session at a time."""
    one, other = make_mosquitto(), make_mosquitto()
    with running(cluster(one.port, other.port)) as (client, events):
        events.wait(Connected)
        one.kill()
        events.wait(Disconnected)
        events.wait(Connected, 2)
        assert client.connected
    assert "lost the broker" in caplog.text
    kinds = [type(event) for event in events.all if isinstance(event, Connected | Disconnected)]
    assert kinds == [Connected, Disconnected, Connected, Disconnected]


def test_a_server_where_no_ping_comes_back_is_left(
    make_mosquitto: MakeMosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """Asked to leave it, the client goes to the other one, and says why."""
    caplog.set_level(logging.INFO)
    one, other = make_mosquitto(), make_mosquitto()
    with running(cluster(one.port, other.port)) as (client, events):
        events.wait(Connected)
        client.leave_mute()
        events.wait(Disconnected)
        events.wait(Connected, 2)
    assert f"127.0.0.1:{other.port}" in caplog.text
    assert "no ping comes back: another server is tried" in caplog.text


def test_a_connection_that_is_no_good_is_made_anew(
    mosquitto: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """The client connects to the only server again, and says why."""
    with running(config_for(mosquitto.port)) as (client, events):
        events.wait(Connected)
        client.connect_anew("it lost an answer")
        events.wait(Disconnected)
        events.wait(Connected, 2)
    assert "it lost an answer" in caplog.text


def test_a_lonely_server_is_not_left(mosquitto: Mosquitto) -> None:
    """Asked to leave the only one, the client stays."""
    with running(config_for(mosquitto.port)) as (client, events):
        events.wait(Connected)
        client.leave_mute()
        client.publish(message("after"))
        events.wait(Acknowledged)
        assert client.connected


def test_stopping_a_client_that_waits_is_prompt() -> None:
    """A pause between attempts does not hold up the stop, and no thread is left."""
    before = threading.active_count()
    with running(config_for(free_port()), backoff=Backoff(first_s=60)) as (client, _):
        wait_until(lambda: client.trouble is not None)
        began = time.monotonic()
        client.stop(10)
        assert time.monotonic() - began < 1
    assert threading.active_count() == before


def test_stopping_a_connected_client_is_prompt(mosquitto: Mosquitto) -> None:
    """A quiet connection is woken from its wait."""
    with running(config_for(mosquitto.port)) as (client, events):
        events.wait(Connected)
        began = time.monotonic()
        client.stop(10)
        assert time.monotonic() - began < 1
        client.stop(10)  # a second time changes nothing


def test_a_stop_does_not_wait_longer_than_it_may(mosquitto: Mosquitto) -> None:
    """A black hole that acknowledges nothing costs the given time and no more."""
    with (
        TcpRelay(mosquitto.port) as relay,
        running(config_for(relay.port)) as (client, events),
    ):
        events.wait(Connected)
        relay.stall()
        client.publish(message("never arrives"))
        began = time.monotonic()
        client.stop(0.2)
        assert 0.2 <= time.monotonic() - began < 1.5
        assert not client.alive()


def test_a_client_that_was_never_started_can_be_stopped() -> None:
    """A start that failed elsewhere leaves clients like this one."""
    client = MqttClient(config_for(1), [COMMANDS], EventLog(), None)
    client.stop(1)
    assert not client.alive()


def test_what_a_callback_raises_is_logged_and_the_thread_lives(
    mosquitto: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """The receiver of a message that raises costs that message alone."""
    events = EventLog()

    def emit(event: object) -> None:
        if isinstance(event, Received) and event.payload == b"bad":
            raise RuntimeError("no good")
        events(event)  # type: ignore[arg-type]  # it is one of them

    client = MqttClient(config_for(mosquitto.port), [COMMANDS], emit, None, backoff=FAST)
    client.start()
    try:
        events.wait(Connected)
        with MqttProbe(mosquitto.port) as probe:
            probe.publish("b/garage/set", "bad")
            probe.publish("b/garage/set", "good")
        assert events.wait(Received).payload == b"good"
        assert client.alive()
    finally:
        client.stop(10)
    errors = [record for record in caplog.records if record.levelno == logging.ERROR]
    assert [record.getMessage() for record in errors] == [
        "the MQTT callback _on_message failed: RuntimeError('no good')"
    ]
    assert "Traceback" in caplog.text


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


def test_a_dead_thread_names_its_cause(
    mosquitto: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    """An unexpected error ends the thread, and `failure` names it."""

    def emit(event: object) -> None:
        if isinstance(event, Connected):
            raise LookupError("queue is gone")  # noqa: TRY004  # any error will do

    client = MqttClient(config_for(mosquitto.port), [COMMANDS], emit, None, backoff=FAST)
    client.start()
    wait_until(lambda: not client.alive())
    assert client.failure == "LookupError: queue is gone"
    assert not client.connected
    assert client.publish(message("ON")) is None
    assert "the MQTT thread died" in caplog.text
    client.stop(1)
