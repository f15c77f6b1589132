"""The figures of lines and stations in Home Assistant."""

from support.entities import of_bridge, of_station

_OF_STATION = ("poll_time", "reply_time", "errors", "last_seen")
_OF_LINE = ("line_main_cycle", "line_main_utilisation")


def test_figures_are_off_until_somebody_wants_them() -> None:
    """They change all the time; each is read from the diagnostics of its station, or its line."""
    station, bridge = of_station(), of_bridge()
    for found, names, topic in (
        (station, _OF_STATION, "wisco/garage/diagnostics"),
        (bridge, _OF_LINE, "wisco/bridge/line/main/diagnostics"),
    ):
        for figure in (found[f"{name}_sensor"] for name in names):
            assert figure["enabled_by_default"] is False
            assert (figure["entity_category"], figure["state_topic"]) == ("diagnostic", topic)
    assert station["errors_sensor"]["state_class"] == "total_increasing"


def test_a_figure_of_a_line_needs_its_port() -> None:
    """A figure of a line is available only while its port is."""
    topics = [entry["topic"] for entry in of_bridge()["line_main_cycle_sensor"]["availability"]]
    assert topics == ["wisco/bridge/state", "wisco/bridge/line/main/availability"]
