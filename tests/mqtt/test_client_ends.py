"""The ends of a connection and of the client's thread, at a real mosquitto."""

import logging
import socket
import threading
import time
from typing import NoReturn

import pytest
from support.event_log import EventLog, wait_until, warnings_in
from support.mosquitto import Mosquitto, free_port
from support.mqtt_probe import MqttProbe
from support.running_client import COMMANDS, FAST, both_versions, config_for, message, running
from support.tcp_relay import TcpRelay

from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import (
    Acknowledged,
    Connected,
    Disconnected,
    OutMessage,
    Received,
)
from bridge.mqtt.reconnect import Backoff

pytestmark = pytest.mark.warns  # what goes wrong here is logged


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
