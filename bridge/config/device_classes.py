"""The device classes of Home Assistant's binary sensors."""

# https://developers.home-assistant.io/docs/core/entity/binary-sensor, "Available device
# classes"; the words are the values of BinarySensorDeviceClass in Home Assistant's
# homeassistant/components/binary_sensor/__init__.py.
BINARY_SENSOR_DEVICE_CLASSES = (
    "battery",
    "battery_charging",
    "carbon_monoxide",
    "cold",
    "connectivity",
    "door",
    "garage_door",
    "gas",
    "heat",
    "light",
    "lock",
    "moisture",
    "motion",
    "moving",
    "occupancy",
    "opening",
    "plug",
    "power",
    "presence",
    "problem",
    "running",
    "safety",
    "smoke",
    "sound",
    "tamper",
    "update",
    "vibration",
    "window",
)
