"""The verdicts of a station as Home Assistant's event, and the last refusal as a text."""

from support.entities import of_station


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
