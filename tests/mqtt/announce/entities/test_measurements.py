"""The figures of lines and stations in Home Assistant."""

from support.entities import of_bridge, of_station

_OF_STATION = ("poll_time", "reply_time", "errors", "last_seen")
_OF_LINE = ("line_main_cycle", "line_main_utilisation")


def test_figures_are_off_until_somebody_wants_them() -> None:
    """Figures are disabled by default, because they change all the time."""
    station, bridge = of_station(), of_bridge()
    figures = [station[f"{one}_sensor"] for one in _OF_STATION]
    figures += [bridge[f"{one}_sensor"] for one in _OF_LINE]
    assert {figure["enabled_by_default"] for figure in figures} == {False}
    assert {figure["entity_category"] for figure in figures} == {"diagnostic"}


def test_each_figure_is_read_from_its_diagnostics_topic() -> None:
    """A station's from its own, a line's from its own."""
    station, bridge = of_station(), of_bridge()
    assert {station[f"{one}_sensor"]["state_topic"] for one in _OF_STATION} == {
        "wisco/garage/diagnostics"
    }
    assert {bridge[f"{one}_sensor"]["state_topic"] for one in _OF_LINE} == {
        "wisco/bridge/line/main/diagnostics"
    }


def test_errors_only_ever_grow() -> None:
    """Home Assistant takes a smaller value for a new start of the bridge."""
    assert of_station()["errors_sensor"]["state_class"] == "total_increasing"


def test_a_figure_of_a_line_needs_its_port() -> None:
    """A figure of a line is available only while its port is."""
    topics = [entry["topic"] for entry in of_bridge()["line_main_cycle_sensor"]["availability"]]
    assert topics == ["wisco/bridge/state", "wisco/bridge/line/main/availability"]
