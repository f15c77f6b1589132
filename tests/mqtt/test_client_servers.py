"""The client with several servers, of which some are off or mute."""

import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from support.mosquitto import Mosquitto, free_port
from support.running_client import FAST, MakeMosquitto, config_for, message, running

from bridge.config.schema import MqttConfig, Server
from bridge.mqtt.events import (
    Acknowledged,
    Connected,
    Disconnected,
)

pytestmark = pytest.mark.warns  # what goes wrong here is logged


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
