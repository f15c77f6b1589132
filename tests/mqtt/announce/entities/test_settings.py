"""Modes and hold times as Home Assistant offers them."""

from dataclasses import replace
from typing import Any

import pytest
from support.entities import LINE, of_output, of_station
from support.house import GARAGE

from bridge.config.schema import LineConfig, OutputConfig
from bridge.model import LineProtocol, Writes

_BOTH = {"do_4_mode_select", "do_4_hold_number"}


def settings_of(output: OutputConfig, line: LineConfig = LINE) -> set[str]:
    """Gives the component ids of the settings of an output."""
    return {key for key in of_output(output, line) if key.endswith(("_select", "_number"))}


@pytest.mark.parametrize(
    ("declared", "offered"),
    [
        ({}, _BOTH),
        ({"mode": "latch"}, set()),
        ({"hold_s": 0.5}, {"do_4_mode_select"}),
        ({"mode": "pulse", "hold_s": 0.5}, set()),
        ({"read_only": True}, set()),
    ],
)
def test_what_the_configuration_declares_is_not_offered(
    declared: dict[str, Any], offered: set[str]
) -> None:
    """A declared mode or hold time has no entity, and a declared latch uses no hold time."""
    assert settings_of(OutputConfig(4, **declared)) == offered


@pytest.mark.parametrize(
    ("protocol", "writes", "address", "offered"),
    [
        (LineProtocol.WISCO, Writes.AUTO, 1, True),
        (LineProtocol.WISCO, Writes.MODBUS, 1, True),
        (LineProtocol.WISCO, Writes.WISCO, 1, False),
        (LineProtocol.WISCO, Writes.AUTO, 0, False),
        (LineProtocol.MODBUS_RTU, Writes.AUTO, 1, True),
        (LineProtocol.MODBUS_ASCII, Writes.AUTO, 1, True),
    ],
)
def test_settings_are_offered_where_modbus_frames_reach_the_station(
    protocol: LineProtocol, writes: Writes, address: int, offered: bool
) -> None:
    """Wisco frames know no settings, and station 0 takes no others."""
    line = replace(LINE, protocol=protocol, writes=writes)
    config = replace(GARAGE, address=address, outputs=(OutputConfig(4),))
    assert (set(of_station(config, line)) >= _BOTH) is offered


def test_settings_are_off_until_they_are_enabled() -> None:
    """An owner who needs no settings does not see up to 32 of them on a page."""
    found = of_output(OutputConfig(4))
    assert {found[key]["enabled_by_default"] for key in _BOTH} == {False}


def test_added_words_are_in_the_language_of_the_configuration() -> None:
    """A Thai name is not followed by an English word."""
    config = replace(GARAGE, outputs=(OutputConfig(4, name="โคมไฟ"),))
    hold = of_station(config, language="th")["do_4_hold_number"]
    assert hold["name"] == "โคมไฟ เวลาค้าง"


def test_a_mode_is_one_of_two_words() -> None:
    """A mode is a select with two words, in the configuration category."""
    mode = of_output(OutputConfig(4, name="Pump"))["do_4_mode_select"]
    assert mode["name"] == "Pump mode"
    assert mode["options"] == ["latch", "pulse"]
    assert mode["state_topic"] == "wisco/garage/do/4/mode"
    assert mode["command_topic"] == "wisco/garage/do/4/mode/set"
    assert (mode["entity_category"], mode["optimistic"]) == ("config", False)


def test_a_hold_time_is_what_a_module_can_hold() -> None:
    """Tenths of a second in one byte, of which 0 is none."""
    hold = of_output(OutputConfig(4))["do_4_hold_number"]
    assert hold["name"] == "Output 4 hold time"
    assert (hold["min"], hold["max"], hold["step"]) == (0.1, 25.5, 0.1)
    assert (hold["unit_of_measurement"], hold["device_class"]) == ("s", "duration")
    assert hold["state_topic"] == "wisco/garage/do/4/hold"
    assert hold["command_topic"] == "wisco/garage/do/4/hold/set"
