"""An MQTT bridge for Wisco DIO100 and DO100 modules on RS485."""

__version__ = "0.1.0"
SUPPORT_URL = ""  # where questions go; it is announced once there is such an address
