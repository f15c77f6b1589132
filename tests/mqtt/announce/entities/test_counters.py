"""The entity of a counted input in Home Assistant."""

from dataclasses import replace
from decimal import Decimal
from typing import Any

import pytest
from support.entities import of_station
from support.homeassistant import DEVICE_CLASSES, UNITS
from support.house import GARAGE

from bridge.config.device_classes import COUNTER_DEVICE_CLASSES
from bridge.config.schema import CountConfig, InputConfig


def of_counter(config: CountConfig | None) -> dict[str, dict[str, Any]]:
    """Gives what there is of input 6, and of nothing else."""
    station_config = replace(GARAGE, inputs=(InputConfig(6, count=config),), outputs=())
    return {
        key: value for key, value in of_station(station_config).items() if key.startswith("di_")
    }


def test_a_counted_input_is_a_sensor_besides_its_state() -> None:
    """A counted input has a sensor of class `total_increasing`, besides its state."""
    found = of_counter(CountConfig())
    assert list(found) == ["di_6_binary_sensor", "di_6_sensor"]
    sensor = found["di_6_sensor"]
    assert sensor["state_topic"] == "wisco/garage/di/6/count"
    assert sensor["state_class"] == "total_increasing"
    assert sensor["name"] == "Input 6 count"
    assert not {"unit_of_measurement", "device_class", "value_template"} & set(sensor)


@pytest.mark.parametrize(
    ("factor", "template"),
    [
        ("0.001", "{{ (value | int * 0.001) | round(3) }}"),
        ("0.0003125", "{{ (value | int * 0.0003125) | round(7) }}"),
        ("10", "{{ (value | int * 10) | round(0) }}"),
        ("0.000000001", "{{ (value | int * 0.000000001) | round(9) }}"),
    ],
)
def test_a_factor_is_multiplied_by_home_assistant(factor: str, template: str) -> None:
    """The topic carries edges, whatever one stands for; no more decimals come than it has."""
    sensor = of_counter(CountConfig("kWh", Decimal(factor), "energy"))["di_6_sensor"]
    assert sensor["value_template"] == template
    assert (sensor["unit_of_measurement"], sensor["device_class"]) == ("kWh", "energy")


def test_home_assistant_takes_every_class_and_unit() -> None:
    """Both Home Assistant releases accept every device class and unit of the configuration."""
    for device_class, units in COUNTER_DEVICE_CLASSES.items():
        assert device_class in DEVICE_CLASSES["sensor"]
        assert set(units) <= UNITS[device_class]


def test_another_input_has_none() -> None:
    """Only what the configuration counts."""
    assert list(of_counter(None)) == ["di_6_binary_sensor"]
