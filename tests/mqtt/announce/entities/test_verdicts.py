"""The verdicts of a station as Home Assistant's event."""

from support.entities import of_station


def test_each_status_is_a_type_of_event() -> None:
    """An automation can wait for `done`, and for whatever else a verdict may say."""
    event = of_station()["result_event"]
    assert event["state_topic"] == "wisco/garage/result"
    assert event["event_types"] == ["done", "failed", "refused", "unknown"]
    assert event["entity_category"] == "diagnostic"
