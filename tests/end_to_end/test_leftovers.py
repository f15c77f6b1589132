"""Retained topics that are no longer configured are cleared, and no others."""

from pathlib import Path

from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, wait_for_held
from support.panel import BASE, broker, is_complete, panel, write_config

from bridge.config.load import load_config
from bridge.model import LineProtocol
from bridge.mqtt.announce.discovery import discovery_messages

OTHERS = {
    f"{BASE}/pumps/do/1/set": "ON",  # a retained command is its sender's business
    f"{BASE}/notes": "call the electrician",
    f"{BASE}/loft/bridge/state": "online",  # another bridge, below us
    f"{BASE}/loft/do/1": '{"di":{},"do":{}}',
    f"{BASE}/loft/availability": "online",
    "wisco2/pumps/availability": "online",
    "homeassistant/device/wisco__loft__do/config": "{}",
    "homeassistant/switch/zigbee/do_1_switch/config": "{}",
}
EVERYTHING = (f"{BASE}/#", "wisco2/#", "homeassistant/#")


def of_pumps(held: dict[str, str]) -> set[str]:
    """Return the retained topics of the second station."""
    return {topic for topic in set(held) - set(OTHERS) if "pumps" in topic}


def without_pumps(config: Path) -> None:
    """Takes the second station out of the file."""
    lines = config.read_text().splitlines(keepends=True)
    config.write_text("".join(line for line in lines if "pumps" not in line))


def test_a_station_that_is_gone_leaves_nothing(tmp_path: Path) -> None:
    """After a start without it not one retained topic of it is left; other people's all are."""
    with panel(LineProtocol.MODBUS_RTU) as line, broker(tmp_path) as mosquitto:
        config = write_config(tmp_path, line, mosquitto.port, discovery="single")
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe:
            for topic, payload in OTHERS.items():
                probe.publish(topic, payload, retain=True)
            with Daemon(config) as daemon:
                probe.wait_for(is_complete)
                wait_for_held(mosquitto.port, EVERYTHING, lambda held: len(of_pumps(held)) > 50)
                daemon.stop()
            without_pumps(config)
            with Daemon(config):
                held = wait_for_held(mosquitto.port, EVERYTHING, lambda held: not of_pumps(held))
                probe.wait_message(f"{BASE}/garage/availability", "online")
            assert OTHERS.items() <= held.items()
            assert not line.module(2).switchings


def test_a_change_of_the_form_leaves_one_form(tmp_path: Path) -> None:
    """Each entity is announced under one topic in the end, whichever way it went."""
    with (
        panel(LineProtocol.MODBUS_RTU) as line,
        broker(tmp_path) as mosquitto,
        MqttProbe(mosquitto.port, f"{BASE}/bridge/state") as probe,
    ):
        for discovery in ("single", "device", "off"):
            config = write_config(tmp_path, line, mosquitto.port, discovery=discovery)
            probe.clear()
            count = len(discovery_messages(load_config(config, {})))
            with Daemon(config) as daemon:
                probe.wait_message(f"{BASE}/bridge/state", "online")
                wait_for_announcements(mosquitto.port, count)
                daemon.stop()


def wait_for_announcements(port: int, count: int) -> None:
    """Waits until so many topics announce something."""
    wait_for_held(port, ["homeassistant/#"], lambda held: len(held) == count)


def test_a_broker_that_lets_nobody_look_gets_everything_all_the_same(tmp_path: Path) -> None:
    """With an access list that hides retained messages, states and devices are published."""
    acl = (
        f"user bridge\ntopic readwrite {BASE}/bridge/#\ntopic read {BASE}/+/set\n"
        f"topic read {BASE}/+/do/+/set\ntopic write {BASE}/#\ntopic write homeassistant/#\n"
        "user probe\ntopic readwrite #\n"
    )
    users = {"bridge": "b", "probe": "p"}
    mosquitto = Mosquitto(tmp_path / "mosquitto", users=users, acl=acl)
    mosquitto.start()
    try:
        with panel(LineProtocol.MODBUS_RTU) as line:
            config = write_config(tmp_path, line, mosquitto.port)
            account = f"port: {mosquitto.port}, username: bridge, password: {users['bridge']}"
            config.write_text(config.read_text().replace(f"port: {mosquitto.port}", account))
            probe = MqttProbe(mosquitto.port, "#", username="probe", password=users["probe"])
            with probe, Daemon(config):
                probe.wait_for(is_complete)
                announced = {m.topic for m in probe.seen if m.retain}
                assert "homeassistant/device/wisco__garage/config" in announced
    finally:
        mosquitto.stop()
