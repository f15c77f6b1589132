"""The device classes of Home Assistant's binary sensors, covers, and sensors that count."""

from collections.abc import Mapping

# https://developers.home-assistant.io/docs/core/entity/binary-sensor, "Available device
# classes"; the words are the values of BinarySensorDeviceClass in Home Assistant's
# homeassistant/components/binary_sensor/__init__.py.
BINARY_SENSOR_DEVICE_CLASSES = (
    "battery", "battery_charging", "carbon_monoxide", "cold", "connectivity", "door",
    "garage_door", "gas", "heat", "light", "lock", "moisture", "motion", "moving", "occupancy",
    "opening", "plug", "power", "presence", "problem", "running", "safety", "smoke", "sound",
    "tamper", "update", "vibration", "window",
)  # fmt: skip

# The sensors that may be `total_increasing`, and the units that each may have, as 2024.3.3 and
# 2026.11.0 both know them: DEVICE_CLASS_STATE_CLASSES and DEVICE_CLASS_UNITS in Home
# Assistant's homeassistant/components/sensor/const.py.
COUNTER_DEVICE_CLASSES: Mapping[str, tuple[str, ...]] = {
    "distance": ("mm", "cm", "m", "km", "in", "ft", "yd", "mi"),
    "duration": ("ms", "s", "min", "h", "d"),
    "energy": ("Wh", "kWh", "MWh", "MJ", "GJ"),
    "gas": ("m³", "ft³", "CCF"),
    "precipitation": ("mm", "cm", "in"),
    "volume": ("mL", "L", "m³", "fl. oz.", "gal", "ft³", "CCF"),
    "water": ("L", "m³", "gal", "ft³", "CCF"),
    "weight": ("mg", "g", "kg", "oz", "lb", "st"),
}
# homeassistant/components/cover/__init__.py: the values of CoverDeviceClass.
COVER_DEVICE_CLASSES = (
    "awning", "blind", "curtain", "damper", "door", "garage", "gate", "shade", "shutter",
    "window",
)  # fmt: skip
