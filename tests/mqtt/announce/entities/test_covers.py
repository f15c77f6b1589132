"""The entity of a cover in Home Assistant."""

from dataclasses import replace

from support.covers import SHUTTER, cover_station
from support.entities import of_station
from support.homeassistant import complaints
from support.house import GARAGE

from bridge.config.schema import OutputConfig


def test_a_cover_is_moved_stopped_and_set_to_a_position() -> None:
    """Words and topics are those of docs/topics.md; nothing is optimistic."""
    cover = of_station(cover_station(GARAGE))["cover_shutter_cover"]
    assert cover["name"] == "Shutter"
    assert cover["device_class"] == "shutter"
    assert cover["command_topic"] == "wisco/garage/cover/shutter/set"
    assert cover["state_topic"] == "wisco/garage/cover/shutter/state"
    assert cover["position_topic"] == "wisco/garage/cover/shutter/position"
    assert cover["set_position_topic"] == "wisco/garage/cover/shutter/position/set"
    assert (cover["position_open"], cover["position_closed"]) == (100, 0)
    assert (cover["optimistic"], cover["qos"]) == (False, 1)
    words = {key: value for key, value in cover.items() if key.startswith(("payload", "state_"))}
    assert words == {
        "payload_open": "OPEN",
        "payload_close": "CLOSE",
        "payload_stop": "STOP",
        "state_topic": "wisco/garage/cover/shutter/state",
        "state_open": "open",
        "state_opening": "opening",
        "state_closed": "closed",
        "state_closing": "closing",
        "state_stopped": "stopped",
    }
    assert complaints("cover", cover) == []


def test_a_cover_of_no_class_has_none() -> None:
    """Home Assistant shows it as it shows any cover."""
    config = replace(cover_station(GARAGE), covers=(replace(SHUTTER, device_class=None),))
    assert "device_class" not in of_station(config)["cover_shutter_cover"]


def test_the_outputs_of_a_cover_are_shown_and_not_switched() -> None:
    """The outputs of a cover are only shown: they have no switch and no settings."""
    outputs = tuple(OutputConfig(n, mode="latch") for n in (1, 2))
    found = of_station(cover_station(replace(GARAGE, outputs=outputs)))
    of_outputs = {key for key in found if key.startswith("do_")}
    assert of_outputs == {"do_1_binary_sensor", "do_2_binary_sensor"}
    assert {found[key]["entity_category"] for key in of_outputs} == {"diagnostic"}
    assert found["do_1_binary_sensor"]["name"] == "Output 1 relay"
