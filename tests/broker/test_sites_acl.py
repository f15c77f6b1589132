"""docs/fleet/acl in a real mosquitto: a site reaches what is its own, and nothing of another."""

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe
from support.panel import panel, results, write_config

from bridge.model import LineProtocol

ACL = (Path(__file__).parents[2] / "docs" / "fleet" / "acl").read_text()
SITES = ("north", "south")
USERS = {
    user: f"{user}'s secret" for user in (*SITES, *re.findall(r"^user (\S+)$", ACL, re.MULTILINE))
}
COMMAND = "north/cellar/garage/do/1/set"


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[Mosquitto]:
    """A broker with the list."""
    broker = Mosquitto(tmp_path / "mosquitto", users=USERS, acl=ACL)
    broker.start()
    yield broker
    broker.stop()


def _client(mosquitto: Mosquitto, user: str, *filters: str) -> MqttProbe:
    return MqttProbe(mosquitto.port, *filters, username=user, password=USERS[user])


def test_a_site_works_behind_the_list(mosquitto: Mosquitto, tmp_path: Path) -> None:
    """Its bridge announces and obeys, and complains of nothing; its Home Assistant commands."""
    with ExitStack() as stack:
        line = stack.enter_context(panel(LineProtocol.MODBUS_RTU))
        config = write_config(tmp_path, line, mosquitto.port)
        login = f"mqtt: {{base_topic: north/cellar, username: north, password: {USERS['north']!r}, "
        prefix = "prefix: north/homeassistant, status_topic: north/homeassistant/status, "
        text = config.read_text().replace("mqtt: {", login)
        config.write_text(text.replace("homeassistant: {", f"homeassistant: {{{prefix}"))
        own = stack.enter_context(_client(mosquitto, "north-ha", "north/#"))
        daemon = stack.enter_context(Daemon(config))
        own.wait_message("north/homeassistant/device/north__cellar__garage/config")
        own.wait_message("north/cellar/bridge/state", "online")
        own.publish(COMMAND, '{"state": "ON", "id": "x"}')
        own.wait_for(lambda seen: any(verdict["status"] == "done" for verdict in results(seen)))
        assert daemon.stop()[0] == 0
        assert "WARNING bridge.mqtt" not in daemon.log


@pytest.mark.parametrize("user", ["south", "south-ha", "viewer"])
def test_a_stranger_to_a_site_commands_nothing_there(mosquitto: Mosquitto, user: str) -> None:
    """What it publishes to another site arrives nowhere."""
    with (
        _client(mosquitto, "owner", "#") as owner,
        _client(mosquitto, user) as stranger,
    ):
        for topic in (COMMAND, "north/cellar/bridge/state", "north/homeassistant/device/x/config"):
            stranger.publish(topic, "by a stranger")
        owner.publish("last", "")
        owner.wait_message("last")
        assert not [message for message in owner.seen if message.topic.startswith("north")]


@pytest.mark.parametrize("user", ["south", "south-ha"])
def test_a_site_sees_nothing_of_another(mosquitto: Mosquitto, user: str) -> None:
    """It hears its own site, and not its neighbour."""
    with (
        _client(mosquitto, user, "north/#", "south/#") as other,
        _client(mosquitto, "owner") as owner,
    ):
        owner.publish("north/cellar/garage/do/1", "ON")
        owner.publish("south/hall/garage/do/1", "ON")
        other.wait_message("south/hall/garage/do/1")
        assert {message.topic for message in other.seen} == {"south/hall/garage/do/1"}
