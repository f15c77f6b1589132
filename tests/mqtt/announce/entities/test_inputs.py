"""The entity of an input in Home Assistant."""

from support.entities import of_station


def test_names_are_the_owners_or_say_the_channel() -> None:
    """An unnamed input is called by its number."""
    found = of_station()
    assert found["di_1_binary_sensor"]["name"] == "Door"
    assert found["di_3_binary_sensor"]["name"] == "Input 3"


def test_an_input_has_its_device_class_or_none() -> None:
    """Home Assistant shows a door as open and closed only where it knows that it is one."""
    found = of_station()
    assert found["di_1_binary_sensor"]["device_class"] == "door"
    assert "device_class" not in found["di_3_binary_sensor"]
    assert found["di_3_binary_sensor"]["state_topic"] == "wisco/garage/di/3"
