"""The verdicts of a station as Home Assistant's event, and the last refusal as a text."""

from dataclasses import replace

from support.entities import of_station
from support.house import GARAGE, make_config

from bridge.config.schema import OutputConfig, RuleConfig, RuleOrder
from bridge.mqtt.announce.discovery import discovery_messages


def test_each_status_is_a_type_of_event() -> None:
    """An automation can wait for `done`, and for whatever else a verdict may say."""
    event = of_station()["result_event"]
    assert event["state_topic"] == "wisco/garage/result"
    assert event["event_types"] == ["done", "failed", "refused", "unknown"]
    assert event["entity_category"] == "diagnostic"


def test_the_last_refusal_is_a_text() -> None:
    """Target and reason in words; a command that was done leaves the last refusal."""
    sensor = of_station()["last_refusal_sensor"]
    assert sensor["state_topic"] == "wisco/garage/result"
    assert sensor["value_template"] == (
        "{% if value_json.status == 'done' %}{{ this.state }}{% else %}{{ value_json.target }}: "
        "{{ value_json.reason | default(value_json.status) | replace('_', ' ') }}{% endif %}"
    )


def test_what_the_bridge_does_by_itself_is_a_text_with_a_list() -> None:
    """Its topic is retained, so it also tells what was done while Home Assistant was away."""
    outputs = (OutputConfig(1, max_on_s=600.0), OutputConfig(2))
    sensor = of_station(replace(GARAGE, outputs=outputs))["own_action_sensor"]
    assert sensor["state_topic"] == sensor["json_attributes_topic"] == "wisco/garage/own_actions"
    assert sensor["value_template"] == "{{ value_json.last }}"


def test_a_station_at_which_a_rule_switches_has_own_actions() -> None:
    """The rule may belong to an input of another station."""
    order = RuleOrder("garage", "do/1", "ON", mask=1)
    rule = RuleConfig("stairs", "Stairs", "attic", 3, "ON", (order,))
    config = replace(make_config(), rules=(rule,))
    [topic] = [
        message.topic
        for message in discovery_messages(config)
        if b"own_action_sensor" in message.payload
    ]
    assert topic == "homeassistant/device/wisco__garage/config"


def test_a_station_that_only_obeys_has_no_own_actions() -> None:
    """Without `max_on`, `on_loss` and covers there is nothing to tell."""
    assert "own_action_sensor" not in of_station()
