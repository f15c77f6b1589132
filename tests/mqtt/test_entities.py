"""What each channel is in Home Assistant, and what it is true of."""

from dataclasses import replace
from typing import Any

import pytest
from support.house import GARAGE, make_config

from bridge.config.schema import OutputConfig, StationConfig
from bridge.mqtt.entities import Entity, bridge_entities, station_entities
from bridge.mqtt.topics import Topics

TOPICS = Topics("wisco")
LINE = make_config().lines[0]


def options_by_id(entities: list[Entity]) -> dict[str, dict[str, Any]]:
    """Gives each entity's options by its component id."""
    return {entity.component_id: entity.options for entity in entities}


def entities_of(name: str) -> dict[str, dict[str, Any]]:
    """Gives the entities of the bridge or of the garage."""
    if name == "bridge":
        return options_by_id(bridge_entities(TOPICS))
    return options_by_id(station_entities(TOPICS, LINE, GARAGE))


def with_output(output: OutputConfig) -> dict[str, dict[str, Any]]:
    """Gives the entities of a station that has this one output."""
    station: StationConfig = replace(GARAGE, inputs=(), outputs=(output,))
    return options_by_id(station_entities(TOPICS, LINE, station))


def test_names_are_the_owners_or_say_the_channel() -> None:
    """An unnamed channel is called by its kind and number."""
    found = entities_of("garage")
    assert found["di_1_binary_sensor"]["name"] == "Door"
    assert found["di_3_binary_sensor"]["name"] == "Input 3"
    assert found["do_4_switch"]["name"] == "Output 4"


def test_an_input_has_its_device_class_or_none() -> None:
    """Home Assistant shows a door as open and closed only where it knows that it is one."""
    found = entities_of("garage")
    assert found["di_1_binary_sensor"]["device_class"] == "door"
    assert "device_class" not in found["di_3_binary_sensor"]
    assert found["di_3_binary_sensor"]["state_topic"] == "wisco/garage/di/3"


@pytest.mark.parametrize(
    ("kind", "on", "off"),
    [
        ("switch", {"payload_on", "state_on"}, {"payload_off", "state_off"}),
        ("light", {"payload_on"}, {"payload_off"}),
        ("fan", {"payload_on"}, {"payload_off"}),
        ("siren", {"payload_on", "state_on"}, {"payload_off", "state_off"}),
        ("valve", {"payload_open", "state_open"}, {"payload_close", "state_closed"}),
        ("lock", {"payload_unlock", "state_unlocked"}, {"payload_lock", "state_locked"}),
    ],
)
def test_an_output_is_the_platform_that_was_asked_for(
    kind: str, on: set[str], off: set[str]
) -> None:
    """Whatever it is called there, ON and OFF are what goes over the wire: ON is open, unlocked."""
    component = with_output(OutputConfig(8, kind=kind))[f"do_8_{kind}"]
    assert component["command_topic"] == "wisco/garage/do/8/set"
    assert component["state_topic"] == "wisco/garage/do/8"
    assert (component["optimistic"], component["qos"]) == (False, 1)
    assert {key for key, value in component.items() if value == "ON"} == on
    assert {key for key, value in component.items() if value == "OFF"} == off


def test_a_siren_is_switched_by_words_alone() -> None:
    """No tones, no loudness, no duration: a relay has none, and none is sent."""
    siren = with_output(OutputConfig(1, kind="siren"))["do_1_siren"]
    assert (siren["support_duration"], siren["support_volume_set"]) == (False, False)
    assert siren["command_template"] == "{{ value }}"


def test_a_pulse_is_a_button_and_an_indicator() -> None:
    """A pulse output cannot be switched OFF, so it is never a switch."""
    found = with_output(OutputConfig(2, name="Gate", mode="pulse"))
    channel = {key: value for key, value in found.items() if key.startswith("do_")}
    assert list(channel) == ["do_2_button", "do_2_binary_sensor"]
    assert channel["do_2_button"]["payload_press"] == "PRESS"
    assert channel["do_2_button"]["command_topic"] == "wisco/garage/do/2/set"
    assert channel["do_2_binary_sensor"]["state_topic"] == "wisco/garage/do/2"
    assert "command_topic" not in channel["do_2_binary_sensor"]
    assert {component["name"] for component in channel.values()} == {"Gate"}


@pytest.mark.parametrize("mode", [None, "latch", "pulse"])
def test_a_read_only_output_is_an_indicator_alone(mode: str | None) -> None:
    """What may not be switched has nothing to press."""
    found = with_output(OutputConfig(3, mode=mode, read_only=True))
    assert [key for key in found if key.startswith("do_")] == ["do_3_binary_sensor"]
    assert "command_topic" not in found["do_3_binary_sensor"]


def test_a_channel_is_available_while_bridge_line_and_station_are() -> None:
    """A value is true only while all three are there."""
    for component_id, component in entities_of("garage").items():
        if component_id.startswith(("di_", "do_")):
            assert component["availability_mode"] == "all"
            assert component["availability"] == [
                {
                    "topic": topic,
                    "payload_available": "online",
                    "payload_not_available": "offline",
                }
                for topic in (
                    "wisco/bridge/state",
                    "wisco/bridge/line/main/availability",
                    "wisco/garage/availability",
                )
            ]


@pytest.mark.parametrize(
    ("name", "component_id", "state_topic"),
    [
        ("bridge", "connectivity_binary_sensor", "wisco/bridge/state"),
        ("garage", "connectivity_binary_sensor", "wisco/garage/availability"),
        ("garage", "problem_binary_sensor", "wisco/garage/problem"),
    ],
)
def test_how_a_device_is_stays_visible_when_it_is_gone(
    name: str, component_id: str, state_topic: str
) -> None:
    """Connectivity and problem need the bridge alone, and are marked as diagnostic."""
    component = entities_of(name)[component_id]
    assert component["state_topic"] == state_topic
    assert component["entity_category"] == "diagnostic"
    assert [entry["topic"] for entry in component["availability"]] == ["wisco/bridge/state"]


def test_connectivity_reads_the_words_of_availability() -> None:
    """These topics say online and offline, not ON and OFF."""
    component = entities_of("garage")["connectivity_binary_sensor"]
    assert component["device_class"] == "connectivity"
    assert (component["payload_on"], component["payload_off"]) == ("online", "offline")


def test_a_problem_shows_its_reason() -> None:
    """The state comes out of the JSON, and the rest of it is shown beside."""
    component = entities_of("garage")["problem_binary_sensor"]
    assert component["device_class"] == "problem"
    assert component["value_template"] == "{{ value_json.state }}"
    assert component["json_attributes_topic"] == "wisco/garage/problem"
