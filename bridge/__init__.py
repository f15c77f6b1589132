"""An MQTT bridge for Wisco DIO100 and DO100 modules on RS485."""

__version__ = "0.1.0"
