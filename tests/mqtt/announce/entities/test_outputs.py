"""The entity of an output in Home Assistant."""

import pytest
from support.entities import of_output

from bridge.config.schema import OutputConfig


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
    """Each platform sends ON and OFF; ON opens a valve and unlocks a lock."""
    component = of_output(OutputConfig(8, kind=kind))[f"do_8_{kind}"]
    assert component["name"] == "Output 8"
    assert component["command_topic"] == "wisco/garage/do/8/set"
    assert component["state_topic"] == "wisco/garage/do/8"
    assert (component["optimistic"], component["qos"]) == (False, 1)
    assert {key for key, value in component.items() if value == "ON"} == on
    assert {key for key, value in component.items() if value == "OFF"} == off


def test_a_siren_is_switched_by_words_alone() -> None:
    """No tones, no loudness, no duration: a relay has none, and none is sent."""
    siren = of_output(OutputConfig(1, kind="siren"))["do_1_siren"]
    assert (siren["support_duration"], siren["support_volume_set"]) == (False, False)
    assert siren["command_template"] == "{{ value }}"


def test_a_pulse_is_a_button_and_an_indicator() -> None:
    """A pulse output cannot be switched OFF, so it is never a switch."""
    found = of_output(OutputConfig(2, name="Gate", mode="pulse", hold_s=0.5))
    assert list(found) == ["do_2_button", "do_2_binary_sensor"]
    assert found["do_2_button"]["payload_press"] == "PRESS"
    assert found["do_2_button"]["command_topic"] == "wisco/garage/do/2/set"
    assert found["do_2_binary_sensor"]["state_topic"] == "wisco/garage/do/2"
    assert "command_topic" not in found["do_2_binary_sensor"]
    assert [component["name"] for component in found.values()] == ["Gate", "Gate relay"]


@pytest.mark.parametrize("mode", [None, "latch", "pulse"])
def test_a_read_only_output_is_an_indicator_alone(mode: str | None) -> None:
    """A read-only output is only an indicator, without settings."""
    found = of_output(OutputConfig(3, mode=mode, read_only=True))
    assert list(found) == ["do_3_binary_sensor"]
    assert "command_topic" not in found["do_3_binary_sensor"]
