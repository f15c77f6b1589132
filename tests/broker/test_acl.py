"""docs/broker/acl in a real mosquitto: what it allows works, what it forbids does not."""

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe
from support.panel import BASE, is_complete, panel, results, write_config

from bridge.model import LineProtocol
from bridge.mqtt.topics import Topics
from bridge.simulator.line import SimulatedLine

ACL = (Path(__file__).parents[2] / "docs" / "broker" / "acl").read_text()
USERS = {user: f"{user}'s secret" for user in re.findall(r"^user (\S+)$", ACL, re.MULTILINE)}
ANNOUNCED = {
    "device": f"homeassistant/device/{BASE}__garage/config",
    "single": f"homeassistant/switch/{BASE}__garage/do_1_switch/config",
}
# What an earlier configuration left behind.
GONE = {
    f"{BASE}/gone/availability": "offline",
    **{topic.replace("garage", "gone"): '{"components":{}}' for topic in ANNOUNCED.values()},
}
# What the bridge listens to for others, with names in the place of wildcards.
COMMANDS = tuple(
    one.topic_filter.replace("/+", "/garage", 1).replace("/+", "/1")
    for one in Topics(BASE).subscriptions("homeassistant/status")
    if one.topic_filter.endswith("/set")
)
REQUEST = f"{BASE}/bridge/request/diagnostics"
STATES = (f"{BASE}/garage/do/1", f"{BASE}/bridge/state", f"{BASE}/garage/result")
# Who commands what; everything else of COMMANDS, requests and states is nobody's but the owner's.
ALLOWED = {
    "homeassistant": {topic for topic in COMMANDS if topic != f"{BASE}/garage/set"},
    "nodered": {
        t for t in COMMANDS if not t.endswith(("/mode/set", "/hold/set")) and "/rule/" not in t
    },
    "viewer": set(),
    "owner": {*COMMANDS, REQUEST, *STATES},
}

# One client of each, and what it listens to.
LISTENING = {
    "owner": (),
    "viewer": (f"{BASE}/#",),
    "homeassistant": ("homeassistant/#", f"{BASE}/#"),
    "nodered": (f"{BASE}/+/result",),
}


def _client(mosquitto: Mosquitto, user: str, *filters: str) -> MqttProbe:
    return MqttProbe(mosquitto.port, *filters, username=user, password=USERS[user])


class House:
    """A bridge behind the access list, and a client for each of the others."""

    def __init__(self, line: SimulatedLine, mosquitto: Mosquitto, config: Path) -> None:
        self.line = line
        self.mosquitto = mosquitto
        self.config = config


def _login(config: Path) -> None:
    text = config.read_text()
    login = f"mqtt: {{username: wisco, password: {USERS['wisco']!r}, "
    # Modules of a busy machine may be slow: nothing here is about them.
    patient = text.replace("    protocol:", "    timeout: 2s\n    protocol:")
    config.write_text(patient.replace("mqtt: {", login))


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    """A panel, and a broker with the list."""
    mosquitto = Mosquitto(tmp_path / "mosquitto", users=USERS, acl=ACL)
    mosquitto.start()
    with ExitStack() as stack:
        stack.callback(mosquitto.stop)
        line = stack.enter_context(panel(LineProtocol.MODBUS_RTU))
        config = write_config(tmp_path, line, mosquitto.port)
        _login(config)
        yield House(line, mosquitto, config)


@pytest.mark.parametrize("discovery", ANNOUNCED)
def test_everybody_can_do_their_part(house: House, discovery: str) -> None:
    """Discovery, leftovers, commands, verdicts, requests; and the bridge complains of nothing."""
    text = house.config.read_text().replace("discovery: device", f"discovery: {discovery}")
    house.config.write_text(text)
    with ExitStack() as stack:
        owner, viewer, home_assistant, node_red = (
            stack.enter_context(_client(house.mosquitto, user, *filters))
            for user, filters in LISTENING.items()
        )
        for topic, payload in GONE.items():
            owner.publish(topic, payload, retain=True)
        daemon = stack.enter_context(Daemon(house.config))
        viewer.wait_for(is_complete)
        _announces(home_assistant, ANNOUNCED[discovery])
        _obeys(house, home_assistant, node_red)
        owner.publish(REQUEST, "")
        answer = viewer.wait_message(f"{BASE}/bridge/response/diagnostics")
        assert json.loads(answer.payload)["status"] == "ok"
        _has_judged_its_probes(viewer)
        assert daemon.stop()[0] == 0
        assert "WARNING bridge.mqtt" not in daemon.log
        assert "ERROR" not in daemon.log


def _announces(home_assistant: MqttProbe, topic: str) -> None:
    """Home Assistant hears of the devices, of those that are gone, and again when it asks."""
    home_assistant.wait_message(topic)
    for gone in GONE:
        home_assistant.wait_message(gone, "")
    home_assistant.clear()
    home_assistant.publish("homeassistant/status", "online")
    home_assistant.wait_message(topic)


def _obeys(house: House, home_assistant: MqttProbe, node_red: MqttProbe) -> None:
    home_assistant.publish(f"{BASE}/garage/do/1/set", "ON")
    node_red.wait_for(lambda seen: len(results(seen)) == 1)
    node_red.publish(f"{BASE}/pumps/set", '{"do": {"1": "ON", "4": "ON"}}')
    seen = node_red.wait_for(lambda seen: len(results(seen)) == 2)
    assert [verdict["status"] for verdict in results(seen)] == ["done", "done"]
    assert (house.line.module(1).outputs, house.line.module(2).outputs) == (0b1, 0b1001)


def _has_judged_its_probes(viewer: MqttProbe) -> None:
    # Diagnostics come some 5 s after the start, as does the judgement; then two pings more.
    viewer.wait_message(f"{BASE}/garage/diagnostics")
    viewer.clear()
    viewer.wait_for(lambda seen: sum(m.topic == f"{BASE}/bridge/ping" for m in seen) > 2)


@pytest.mark.parametrize("user", ALLOWED)
def test_each_may_publish_what_is_theirs_and_nothing_else(user: str, tmp_path: Path) -> None:
    """Each command topic of the bridge, requests and states: the broker passes on, or drops."""
    everything = [*COMMANDS, REQUEST, *STATES]
    mosquitto = Mosquitto(tmp_path / "mosquitto", users=USERS, acl=ACL)
    mosquitto.start()
    with _client(mosquitto, "owner", f"{BASE}/#") as owner, _client(mosquitto, user) as client:
        for topic in everything:
            client.publish(topic, "tried")
        owner.publish(f"{BASE}/end", "")
        owner.wait_message(f"{BASE}/end")
        passed = {message.topic for message in owner.seen} - {f"{BASE}/end"}
    mosquitto.stop()
    assert passed == ALLOWED[user]


def test_what_the_bridge_may_not_publish_is_named_in_its_log(house: House) -> None:
    """An answer on a response topic that the list knows nothing of; the command is carried out."""
    with (
        _client(house.mosquitto, "nodered", f"{BASE}/#") as node_red,
        Daemon(house.config) as daemon,
    ):
        node_red.wait_for(is_complete)
        node_red.publish(
            f"{BASE}/garage/do/1/set", "ON", response_topic="reply/here", correlation=b"7"
        )
        assert results(node_red.wait_for(lambda seen: bool(results(seen))))[0]["status"] == "done"
        daemon.wait_for_log("did not take a message to 'reply/here': Not authorized")


def test_a_bridge_with_another_base_topic_names_everything_that_the_list_denies(
    house: House,
) -> None:
    """The list and the configuration have to agree: the log says where they do not."""
    text = house.config.read_text().replace("mqtt: {", "mqtt: {base_topic: home/wisco, ")
    house.config.write_text(text)
    with Daemon(house.config) as daemon:
        for topic in ("bridge/info", "bridge/line/main/availability", "garage/do/1", "garage"):
            daemon.wait_for_log(f"did not take a message to 'home/wisco/{topic}': Not authorized")
        daemon.wait_for_log("no ping came back on home/wisco/bridge/ping")
