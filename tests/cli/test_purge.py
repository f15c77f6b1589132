"""`purge`: a broker is left without a trace of the bridge, and others keep theirs."""

from collections.abc import Callable
from pathlib import Path

import pytest
from support.laptop import Ended, Laptop
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, held_at

Call = Callable[[str], Ended]
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


def test_it_clears_what_is_ours_and_nothing_else(laptop: Laptop, call: Call) -> None:
    """It asks first; --yes clears all of ours; a second time it says that there is nothing."""
    ended = call("purge")
    assert (ended.status, ended.out) == (2, "")
    assert "there is no one to ask at a terminal: add --yes" in ended.err
    assert held_at(laptop.broker_port, "#") == OURS | OTHERS
    ended = call("purge --yes")
    assert (ended.status, ended.out) == (0, "")
    assert ended.err.startswith("5 topics below wisco and 2 announcements at 127.0.0.1:")
    assert held_at(laptop.broker_port, "#") == OTHERS
    ended = call("purge")
    assert (ended.status, ended.out) == (0, "")
    assert ended.err.startswith("nothing is retained of wisco at ")


def test_it_leaves_a_running_bridge_alone(laptop: Laptop, call: Call) -> None:
    """It would publish no state anew until it changes."""
    with MqttProbe(laptop.broker_port) as probe:
        probe.publish("wisco/bridge/state", "online", retain=True)
    ended = call("purge --yes")
    assert (ended.status, ended.out) == (1, "")
    assert "the bridge runs: wisco/bridge/state says online; stop it first" in ended.err
    assert set(held_at(laptop.broker_port, "#")) == set(OURS | OTHERS)
    assert call("purge --yes --force").status == 0
