"""The health of a device in Home Assistant, and the availability of its entities."""

import pytest
from support.entities import of_bridge, of_station

from bridge.mqtt.announce.entities import TRIGGER

_ALL_THREE = ["wisco/bridge/state", "wisco/bridge/line/main/availability"]
_ALL_THREE += ["wisco/garage/availability"]


def test_an_entity_is_available_while_bridge_line_and_station_are() -> None:
    """A value is true only while all three are there."""
    for component_id, component in of_station().items():
        if component_id.startswith(("connectivity_", "problem_", "last_refusal_")):
            continue
        if component_id.endswith("_event"):
            continue
        if component_id.endswith(TRIGGER):
            continue  # Home Assistant asks nothing of the kind for these
        assert component["availability_mode"] == "all"
        # With the words that Home Assistant takes where none are given: online and offline.
        assert component["availability"] == [{"topic": topic} for topic in _ALL_THREE]


@pytest.mark.parametrize(
    ("name", "component_id", "state_topic"),
    [
        (
            "bridge",
            "line_main_connectivity_binary_sensor",
            "wisco/bridge/line/main/availability",
        ),
        ("garage", "connectivity_binary_sensor", "wisco/garage/availability"),
        ("garage", "problem_binary_sensor", "wisco/garage/problem"),
    ],
)
def test_how_a_device_is_stays_visible_when_it_is_gone(
    name: str, component_id: str, state_topic: str
) -> None:
    """Connectivity and problem need the bridge alone, and are marked as diagnostic."""
    component = (of_bridge() if name == "bridge" else of_station())[component_id]
    assert component["state_topic"] == state_topic
    assert component["entity_category"] == "diagnostic"
    assert [entry["topic"] for entry in component["availability"]] == ["wisco/bridge/state"]


def test_the_connection_of_the_bridge_can_be_off() -> None:
    """Its `off` is the last will: with an availability by the same topic it was never off."""
    component = of_bridge()["connectivity_binary_sensor"]
    assert component["state_topic"] == "wisco/bridge/state"
    assert component["entity_category"] == "diagnostic"
    assert not {"availability", "availability_mode"} & set(component)


def test_no_event_fires_again_when_a_line_or_module_returns() -> None:
    """Events and the last refusal are available with the bridge alone."""
    found = of_station()
    events = [key for key in found if key.endswith(("_event", "last_refusal_sensor"))]
    assert len(events) >= 2
    for key in events:
        assert found[key]["availability"] == [{"topic": "wisco/bridge/state"}]


def test_connectivity_reads_the_words_of_availability() -> None:
    """These topics say online and offline, not ON and OFF."""
    component = of_station()["connectivity_binary_sensor"]
    assert component["device_class"] == "connectivity"
    assert (component["payload_on"], component["payload_off"]) == ("online", "offline")


def test_a_problem_shows_its_reason() -> None:
    """The state comes out of the JSON, and the rest of it is shown beside."""
    component = of_station()["problem_binary_sensor"]
    assert component["device_class"] == "problem"
    assert component["value_template"] == "{{ value_json.state }}"
    assert component["json_attributes_topic"] == "wisco/garage/problem"
