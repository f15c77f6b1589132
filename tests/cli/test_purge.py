"""`purge`: a broker is left without a trace of the bridge, and others keep theirs."""

from pathlib import Path

import pytest
from support.laptop import Laptop
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, held_at

OURS = {
    "wisco/bridge/state": "offline",
    "wisco/bridge/info": "{}",
    "wisco/garage": "{}",
    "wisco/garage/di/1": "ON",
    "wisco/garage/do/1/set": "ON",
    "homeassistant/device/wisco__garage/config": "{}",
    "homeassistant/switch/wisco__garage/do_1_switch/config": "{}",
}
OTHERS = {
    "wisco/attic/bridge/state": "online",
    "wisco/attic/garage/di/1": "ON",
    "homeassistant/device/zigbee/config": "{}",
    "homeassistant/status": "online",
    "wiscosin/garage/di/1": "ON",
}


@pytest.fixture
def laptop(tmp_path: Path, mosquitto: Mosquitto) -> Laptop:
    """Its broker holds what a bridge left, and what others did."""
    with MqttProbe(mosquitto.port) as probe:
        for topic, payload in (OURS | OTHERS).items():
            probe.publish(topic, payload, retain=True)
    return Laptop(tmp_path, mosquitto.port)


def test_it_clears_what_is_ours_and_nothing_else(laptop: Laptop) -> None:
    """States, a retained command, and both forms of announcements."""
    ended = laptop.run("purge --yes")
    assert (ended.status, ended.out) == (0, "")
    assert ended.err.startswith("5 topics below wisco and 2 announcements at 127.0.0.1:")
    assert held_at(laptop.broker_port, "#") == OTHERS


def test_a_second_time_there_is_nothing(laptop: Laptop) -> None:
    """It says so, and that is fine."""
    laptop.run("purge --yes")
    ended = laptop.run("purge")
    assert (ended.status, ended.out) == (0, "")
    assert ended.err.startswith("nothing is retained of wisco at ")


def test_it_asks_first(laptop: Laptop) -> None:
    """Without a terminal there is no one to ask, and everything stays."""
    ended = laptop.run("purge")
    assert (ended.status, ended.out) == (2, "")
    assert "there is no one to ask at a terminal: add --yes" in ended.err
    assert held_at(laptop.broker_port, "#") == OURS | OTHERS


def test_it_leaves_a_running_bridge_alone(laptop: Laptop) -> None:
    """It would publish no state anew until it changes."""
    with MqttProbe(laptop.broker_port) as probe:
        probe.publish("wisco/bridge/state", "online", retain=True)
    ended = laptop.run("purge --yes")
    assert (ended.status, ended.out) == (1, "")
    assert "the bridge runs: wisco/bridge/state says online; stop it first" in ended.err
    assert set(held_at(laptop.broker_port, "#")) == set(OURS | OTHERS)
    assert laptop.run("purge --yes --force").status == 0
