"""The entity of a button in Home Assistant."""

from dataclasses import replace
from typing import Any

from support.entities import of_station
from support.house import GARAGE

from bridge.config.schema import GestureConfig, InputConfig

TOPIC = "wisco/garage/di/5/event"


def of_button(config: GestureConfig | None) -> dict[str, dict[str, Any]]:
    """Gives what there is of input 5, and of nothing else."""
    station_config = replace(GARAGE, inputs=(InputConfig(5, gestures=config),), outputs=())
    return {
        key: value for key, value in of_station(station_config).items() if key.startswith("di_")
    }


def test_a_button_is_an_event_besides_its_state() -> None:
    """A button has an event with the possible gestures, besides its state."""
    found = of_button(GestureConfig())
    assert list(found) == [
        "di_5_binary_sensor",
        "di_5_event",
        "di_5_short_device_automation",
        "di_5_long_device_automation",
        "di_5_double_device_automation",
    ]
    event = found["di_5_event"]
    assert event["state_topic"] == TOPIC
    assert event["event_types"] == ["short", "long", "double"]
    assert event["device_class"] == "button"
    assert event["name"] == "Input 5 press"


def test_each_gesture_is_a_trigger_of_the_device() -> None:
    """Automations are made by clicking them together, as with a button of any other maker."""
    trigger = of_button(GestureConfig())["di_5_long_device_automation"]
    assert trigger == {
        "automation_type": "trigger",
        "type": "button_long_press",
        "subtype": "di_5",
        "topic": TOPIC,
        "payload": "long",
        "value_template": "{{ value_json.event_type }}",
    }


def test_what_cannot_come_is_not_offered() -> None:
    """`double: 0s` knows no double press."""
    found = of_button(GestureConfig(double_s=0.0))
    assert found["di_5_event"]["event_types"] == ["short", "long"]
    assert "di_5_double_device_automation" not in found


def test_another_input_has_neither() -> None:
    """Only what the configuration says is a button."""
    assert list(of_button(None)) == ["di_5_binary_sensor"]
