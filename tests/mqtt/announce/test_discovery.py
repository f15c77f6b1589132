"""The announcements to Home Assistant: their fixed form, and payloads that it accepts."""

import json
import re
from dataclasses import replace
from typing import Any

import pytest
from support.covers import cover_station
from support.homeassistant import (
    DEVICE_DISCOVERY_KEYS,
    PLATFORMS,
    complaints,
    device_complaints,
)
from support.house import CELLAR, GARAGE, make_config

from bridge import __version__
from bridge.config.schema import Config, WebConfig
from bridge.mqtt.announce.discovery import discovery_messages
from bridge.mqtt.events import OutMessage


def documents(messages: list[OutMessage]) -> dict[str, dict[str, Any]]:
    """Gives each topic's JSON."""
    return {message.topic: json.loads(message.payload) for message in messages}


def components(config: Config, name: str = "garage") -> dict[str, dict[str, Any]]:
    """Gives the components of one device, as device discovery announces them."""
    base = config.mqtt.base_topic.replace("/", "__")
    topic = f"{config.homeassistant.prefix}/device/{base}__{name}/config"
    found: dict[str, dict[str, Any]] = documents(discovery_messages(config))[topic]["components"]
    return found


@pytest.mark.parametrize("discovery", ["device", "single"])
def test_every_message_is_retained_and_acknowledged(discovery: str) -> None:
    """A Home Assistant that starts later finds what it missed."""
    messages = discovery_messages(make_config(discovery))
    assert {(message.qos, message.retain) for message in messages} == {(1, True)}


def test_off_announces_nothing() -> None:
    """With `discovery: off` nothing is announced."""
    assert discovery_messages(make_config("off")) == []


def test_device_discovery_is_a_message_a_device_and_the_bridge_first() -> None:
    """The stations name the bridge, so it has to be there before them."""
    topics = [message.topic for message in discovery_messages(make_config(base="home/io"))]
    assert topics == [
        "homeassistant/device/home__io__bridge/config",
        "homeassistant/device/home__io__garage/config",
        "homeassistant/device/home__io__main_02/config",
    ]


def test_single_discovery_is_a_message_an_entity_and_the_bridge_first() -> None:
    """The older form names platform, node and component in its topic."""
    config = make_config("single", prefix="ha", stations=(CELLAR,))
    assert [message.topic for message in discovery_messages(config)] == [
        "ha/binary_sensor/wisco__bridge/connectivity_binary_sensor/config",
        "ha/binary_sensor/wisco__bridge/line_main_connectivity_binary_sensor/config",
        "ha/sensor/wisco__bridge/line_main_cycle_sensor/config",
        "ha/sensor/wisco__bridge/line_main_utilisation_sensor/config",
        "ha/binary_sensor/wisco__main_02/do_16_binary_sensor/config",
        "ha/binary_sensor/wisco__main_02/connectivity_binary_sensor/config",
        "ha/binary_sensor/wisco__main_02/problem_binary_sensor/config",
        "ha/event/wisco__main_02/result_event/config",
        "ha/sensor/wisco__main_02/last_refusal_sensor/config",
        "ha/sensor/wisco__main_02/poll_time_sensor/config",
        "ha/sensor/wisco__main_02/reply_time_sensor/config",
        "ha/sensor/wisco__main_02/errors_sensor/config",
        "ha/sensor/wisco__main_02/last_seen_sensor/config",
    ]


def test_both_forms_say_the_same_of_an_entity() -> None:
    """A change between the forms changes no entity."""
    singles = documents(discovery_messages(make_config("single")))
    for name in ("bridge", "garage", "main_02"):
        for component_id, component in components(make_config(), name).items():
            platform = component.pop("platform")
            single = singles.pop(f"homeassistant/{platform}/wisco__{name}/{component_id}/config")
            assert {key: single.pop(key) for key in ("device", "origin")}
            assert single == component
    assert singles == {}


def test_the_component_ids_of_a_station() -> None:
    """Channels that are not left out, each with its platform, then how the station is."""
    assert list(components(make_config())) == [
        "di_1_binary_sensor",
        "di_3_binary_sensor",
        "di_5_binary_sensor",
        "di_6_binary_sensor",
        "di_5_event",
        "di_5_short_device_automation",
        "di_5_long_device_automation",
        "di_5_double_device_automation",
        "di_6_sensor",
        "do_1_light",
        "do_2_button",
        "do_2_binary_sensor",
        "do_3_binary_sensor",
        "do_4_switch",
        "do_5_valve",
        "do_6_lock",
        "do_7_siren",
        "do_8_fan",
        "do_1_mode_select",
        "do_1_hold_number",
        "do_4_mode_select",
        "do_4_hold_number",
        "do_5_mode_select",
        "do_5_hold_number",
        "do_6_mode_select",
        "do_6_hold_number",
        "do_7_mode_select",
        "do_7_hold_number",
        "connectivity_binary_sensor",
        "problem_binary_sensor",
        "result_event",
        "last_refusal_sensor",
        "poll_time_sensor",
        "reply_time_sensor",
        "errors_sensor",
        "last_seen_sensor",
    ]


def test_the_ids_of_an_entity() -> None:
    """These are what Home Assistant keeps an entity under: they never change."""
    component = components(make_config(base="home/io"))["do_4_switch"]
    assert component["unique_id"] == "home__io__garage__do_4_switch"
    assert component["object_id"] == "home__io_garage_do_4"
    assert component["default_entity_id"] == "switch.home__io_garage_do_4"


def test_no_two_entities_share_an_id() -> None:
    """Home Assistant refuses the second of two entities with one unique id."""
    singles = documents(discovery_messages(make_config("single"))).values()
    for key in ("unique_id", "default_entity_id"):
        ids = [single[key] for single in singles if "automation_type" not in single]
        assert len(ids) == len(set(ids))


def test_the_device_of_a_station() -> None:
    """The page of the device says what it is, where, and what it is reached through."""
    topic = "homeassistant/device/wisco__garage/config"
    config = make_config(configuration_url="http://bridge.example/")
    assert documents(discovery_messages(config))[topic]["device"] == {
        "identifiers": ["wisco__garage"],
        "name": "Garage ä",
        "manufacturer": "Wisco",
        "model": "DIO100",
        "serial_number": "main, address 1",
        "via_device": "wisco__bridge",
        "suggested_area": "Yard",
        "configuration_url": "http://bridge.example/",
    }


def test_a_station_without_an_area_suggests_none() -> None:
    """An area is the owner's to choose: none is made up."""
    topic = "homeassistant/device/wisco__main_02/config"
    device = documents(discovery_messages(make_config()))[topic]["device"]
    assert not {"suggested_area", "configuration_url"} & set(device)


@pytest.mark.parametrize(
    ("host", "link"),
    [
        ("10.0.0.2", "http://10.0.0.2:8099/"),
        ("fd00::2", "http://[fd00::2]:8099/"),
        ("127.0.0.1", None),
        ("::1", None),
        ("localhost", None),
        ("0.0.0.0", None),  # noqa: S104  # it does not say which address others use
    ],
)
def test_the_link_leads_to_a_panel_that_others_can_reach(host: str, link: str | None) -> None:
    """A configured link goes first."""
    config = replace(make_config(), web=WebConfig(host=host))
    [bridge, garage, *_] = (json.loads(one.payload)["device"] for one in discovery_messages(config))
    assert (bridge.get("configuration_url"), garage.get("configuration_url")) == (link, link)
    shown = replace(config.homeassistant, configuration_url="http://bridge.example/")
    [bridge, *_] = discovery_messages(replace(config, homeassistant=shown))
    assert json.loads(bridge.payload)["device"]["configuration_url"] == "http://bridge.example/"


def test_the_bridge_is_a_device_with_its_version() -> None:
    """The page of the bridge says which version runs, and so does the origin of every device."""
    for document in documents(discovery_messages(make_config())).values():
        assert document["origin"] == {"name": "wisco2mqtt", "sw_version": __version__}
    bridge = documents(discovery_messages(make_config()))[
        "homeassistant/device/wisco__bridge/config"
    ]["device"]
    assert bridge["identifiers"] == ["wisco__bridge"]
    assert bridge["sw_version"] == __version__
    assert "via_device" not in bridge


@pytest.mark.parametrize("discovery", ["device", "single"])
@pytest.mark.parametrize(("protocol", "expiry_s"), [("5", 2), ("3.1.1", None)])
def test_a_command_lapses_on_the_broker_where_the_broker_knows_how(
    discovery: str, protocol: str, expiry_s: int | None
) -> None:
    """To a broker of MQTT 3.1.1 Home Assistant would refuse to send any command with an expiry."""
    announced = documents(discovery_messages(make_config(discovery), protocol)).values()
    entities = [one for each in announced for one in each.get("components", {"": each}).values()]
    senders = [entity for entity in entities if "command_topic" in entity]
    assert {entity["platform"] for entity in senders if "platform" in entity} >= (
        {"button", "switch", "select", "number"} if discovery == "device" else set()
    )
    assert {entity.get("message_expiry_interval") for entity in senders} == {expiry_s}
    others = [entity for entity in entities if "command_topic" not in entity]
    assert not [entity for entity in others if "message_expiry_interval" in entity]


def test_home_assistant_takes_every_entity() -> None:
    """No payload holds a key or value that its platform's schema rejects or drops."""
    seen = set()
    roof = cover_station(replace(CELLAR, address=3, id="roof"))
    config = make_config("single", stations=(GARAGE, CELLAR, roof))
    for topic, payload in documents(discovery_messages(config)).items():
        platform = topic.split("/")[1]
        seen.add(platform)
        assert complaints(platform, payload) == []
        assert device_complaints(payload["device"], payload["origin"]) == []
    assert seen == set(PLATFORMS)


def test_home_assistant_takes_every_device() -> None:
    """The newer form has the keys of its schema, and its components those of their platforms."""
    for payload in documents(discovery_messages(make_config())).values():
        assert set(payload) == DEVICE_DISCOVERY_KEYS
        assert device_complaints(payload["device"], payload["origin"]) == []
        for component in payload["components"].values():
            assert complaints(component.pop("platform"), component) == []


def test_home_assistant_reads_every_topic() -> None:
    """discovery.py, TOPIC_MATCHER: other characters in a topic would be refused."""
    matcher = re.compile(r"\w+/(?:[a-zA-Z0-9_-]+/)?[a-zA-Z0-9_-]+/config")
    station_config = replace(GARAGE, id="north-wing_2")
    for discovery in ("device", "single"):
        config = make_config(discovery, base="home-1/io_2", stations=(station_config,))
        for message in discovery_messages(config):
            assert matcher.fullmatch(message.topic.removeprefix("homeassistant/"))


@pytest.mark.parametrize(
    ("component_id", "change", "complaint"),
    [
        ("di_1_binary_sensor", {"wibble": 1}, "unknown wibble"),
        ("di_5_short_device_automation", {"unique_id": "x"}, "unknown unique_id"),
        ("di_5_short_device_automation", {"type": "press"}, "'press' is none of"),
        ("di_5_short_device_automation", {"topic": ""}, "'' is no topic"),
        ("di_5_event", {"event_types": None}, "None is no list"),
        ("di_6_sensor", {"unit_of_measurement": "kWh"}, "kWh is no unit of water"),
        ("di_1_binary_sensor", {"state_topic": None}, "state_topic: None is no str"),
        ("di_1_binary_sensor", {"state_topic": "a/+"}, "'a/+' is no topic"),
        ("di_1_binary_sensor", {"qos": 3}, "3 is none of"),
        ("di_1_binary_sensor", {"device_class": "portal"}, "no class of binary sensors"),
        ("di_1_binary_sensor", {"default_entity_id": "switch.x"}, "is of switch"),
        (
            "di_1_binary_sensor",
            {"availability": [{"topic": "a", "payload": "x"}]},
            "unknown payload",
        ),
        ("di_1_binary_sensor", {"availability_topic": "a"}, "exclude each other"),
        ("di_1_binary_sensor", {"entity_category": "config"}, "is no configuration"),
        ("do_4_mode_select", {"options": []}, "no options"),
        ("do_4_mode_select", {"options": "latch"}, "is no list"),
        ("do_4_hold_number", {"min": "0.1"}, "is no number"),
        ("do_4_hold_number", {"min": 26}, "min is not below max"),
        ("do_4_hold_number", {"unit_of_measurement": "sec"}, "sec is no unit of duration"),
        ("poll_time_sensor", {"state_class": "rising"}, "'rising' is none of"),
        ("result_event", {"event_types": "done"}, "is no list"),
    ],
)
def test_the_rules_find_mistakes(component_id: str, change: dict[str, Any], complaint: str) -> None:
    """The rules that the payloads are held against can say no."""
    payload = components(make_config())[component_id] | change
    found = complaints(payload.pop("platform"), payload)
    assert any(complaint in each for each in found)
