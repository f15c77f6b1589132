"""What Home Assistant accepts in a discovery payload: its schemas, written down as data.

Read from homeassistant/components/mqtt/ of the releases 2024.3.3 and 2026.11.0. Home Assistant
drops unknown keys without a word, so a slip in a key would show nowhere else.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import UnionType
from typing import Any

# config.py: MQTT_BASE_SCHEMA, MQTT_RO_SCHEMA, MQTT_RW_SCHEMA
_BASE = frozenset({"qos", "encoding"})
_READ = _BASE | {"state_topic", "value_template"}
_WRITE = _BASE | {"command_topic", "optimistic", "retain", "state_topic"}

# mixins.py (2024.3.3) and schemas.py (2026.11.0): MQTT_ENTITY_COMMON_SCHEMA
_COMMON = frozenset(
    {
        "availability",
        "availability_mode",
        "availability_template",
        "availability_topic",
        "default_entity_id",  # 2026.11.0 alone
        "device",
        "enabled_by_default",
        "entity_category",
        "icon",
        "json_attributes_template",
        "json_attributes_topic",
        "message_expiry_interval",  # 2026.11.0 alone
        "name",
        "object_id",  # 2024.3.3 alone
        "origin",
        "payload_available",
        "payload_not_available",
        "unique_id",
    }
)


@dataclass(frozen=True, slots=True)
class PlatformRules:
    """The keys of one platform's DISCOVERY_SCHEMA that both releases know."""

    source: str
    required: frozenset[str]
    own: frozenset[str]
    common: frozenset[str] = _COMMON

    @property
    def allowed(self) -> frozenset[str]:
        """Every key that may stand in a payload."""
        return self.own | self.common


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


def _rules(source: str, required: str, base: frozenset[str], own: str) -> PlatformRules:
    return PlatformRules(source, _words(required), base | _words(own))


PLATFORMS = {
    "binary_sensor": _rules(
        "binary_sensor.py",
        "state_topic",
        _READ,
        "device_class expire_after force_update off_delay payload_off payload_on",
    ),
    "button": _rules(
        "button.py",
        "command_topic",
        _BASE,
        "command_template command_topic device_class payload_press retain",
    ),
    # TRIGGER_DISCOVERY_SCHEMA: a trigger is no entity, and has little in common with them
    "device_automation": PlatformRules(
        "device_trigger.py",
        _words("automation_type subtype topic type"),
        _BASE | _words("automation_type payload subtype topic type value_template"),
        _words("device origin"),
    ),
    "event": _rules("event.py", "event_types state_topic", _READ, "device_class event_types"),
    "cover": _rules(
        "cover.py",
        "",
        _BASE,
        "command_topic device_class optimistic payload_close payload_open payload_stop "
        "position_closed position_open position_template position_topic retain "
        "set_position_template set_position_topic state_closed state_closing state_open "
        "state_opening state_stopped state_topic tilt_closed_value tilt_command_template "
        "tilt_command_topic tilt_max tilt_min tilt_opened_value tilt_optimistic "
        "tilt_status_template tilt_status_topic value_template",
    ),
    "fan": _rules(
        "fan.py",
        "command_topic",
        _WRITE,
        "command_template payload_off payload_on state_value_template",
    ),
    "light": _rules(
        "light/schema_basic.py",
        "command_topic",
        _WRITE,
        "on_command_type payload_off payload_on schema state_value_template",
    ),
    "lock": _rules(
        "lock.py",
        "command_topic",
        _WRITE,
        "code_format command_template payload_lock payload_open payload_reset payload_unlock "
        "state_jammed state_locked state_locking state_unlocked state_unlocking value_template",
    ),
    "number": _rules(
        "number.py",
        "command_topic",
        _WRITE,
        "command_template device_class max min mode payload_reset step unit_of_measurement "
        "value_template",
    ),
    "select": _rules(
        "select.py",
        "command_topic options",
        _WRITE,
        "command_template options value_template",
    ),
    "sensor": _rules(
        "sensor.py",
        "state_topic",
        _READ,
        "device_class expire_after force_update last_reset_value_template state_class "
        "suggested_display_precision unit_of_measurement",
    ),
    "siren": _rules(
        "siren.py",
        "command_topic",
        _WRITE,
        "available_tones command_off_template command_template payload_off payload_on "
        "state_off state_on state_value_template support_duration support_volume_set",
    ),
    "switch": _rules(
        "switch.py",
        "command_topic",
        _WRITE,
        "device_class payload_off payload_on state_off state_on value_template",
    ),
    "valve": _rules(
        "valve.py",
        "",
        _BASE,
        "command_template command_topic device_class optimistic payload_close payload_open "
        "payload_stop position_closed position_open reports_position retain state_closed "
        "state_closing state_open state_opening state_topic value_template",
    ),
}

# schemas.py: MQTT_ENTITY_DEVICE_INFO_SCHEMA, MQTT_ORIGIN_INFO_SCHEMA and the list of availability
DEVICE_KEYS = _words(
    "configuration_url connections hw_version identifiers manufacturer model name "
    "serial_number suggested_area sw_version via_device"
)
ORIGIN_KEYS = frozenset({"name", "sw_version", "support_url"})
AVAILABILITY_KEYS = frozenset(
    {"topic", "payload_available", "payload_not_available", "value_template"}
)
# schemas.py: DEVICE_DISCOVERY_SCHEMA, as far as this project uses it
DEVICE_DISCOVERY_KEYS = frozenset({"device", "origin", "components"})

BOOLEANS = _words(
    "enabled_by_default force_update optimistic reports_position retain support_duration "
    "support_volume_set"
)
NUMBERS = _words("max min step")
INTEGERS = _words("message_expiry_interval position_closed position_open")
LISTS = _words("event_types options")
STRUCTURES = frozenset({"availability", "device", "origin", "qos"})
ENUMERATIONS: Mapping[str, frozenset[Any]] = {
    "qos": frozenset({0, 1, 2}),  # util.py: valid_qos_schema
    "availability_mode": frozenset({"all", "any", "latest"}),  # const.py: AVAILABILITY_MODES
    "entity_category": frozenset({"config", "diagnostic"}),  # helpers/entity.py: EntityCategory
    "automation_type": frozenset({"trigger"}),  # device_automation.py: AUTOMATION_TYPES
    # strings.json of 2024.3.3: those that Home Assistant has words for
    "type": _words(
        "button_double_press button_long_press button_long_release button_quadruple_press "
        "button_quintuple_press button_short_press button_short_release button_triple_press"
    ),
    "mode": frozenset({"auto", "box", "slider"}),  # components/number/const.py: NumberMode
    # components/sensor/const.py: SensorStateClass of 2024.3.3
    "state_class": frozenset({"measurement", "total", "total_increasing"}),
}
# binary_sensor.py, sensor.py: entity_category_without_config
READ_ONLY_PLATFORMS = frozenset({"binary_sensor", "sensor"})
# What 2024.3.3 knows; 2026.11.0 knows these too.
DEVICE_CLASSES: Mapping[str, frozenset[str]] = {
    # homeassistant/components/binary_sensor/__init__.py: BinarySensorDeviceClass
    "binary_sensor": _words(
        "battery battery_charging carbon_monoxide cold connectivity door garage_door gas heat "
        "light lock moisture motion moving occupancy opening plug power presence problem running "
        "safety smoke sound tamper update vibration window"
    ),
    # homeassistant/components/event/__init__.py: EventDeviceClass
    "event": _words("button doorbell motion"),
    # homeassistant/components/cover/__init__.py: CoverDeviceClass
    "cover": _words("awning blind curtain damper door garage gate shade shutter window"),
    # homeassistant/components/number/const.py, sensor/const.py: those that this project uses
    "number": _words("duration"),
    "sensor": _words("distance duration energy gas precipitation timestamp volume water weight"),
}
# homeassistant/components/sensor/const.py and number/const.py: DEVICE_CLASS_UNITS; what 2024.3.3
# and 2026.11.0 both take
UNITS: Mapping[str, frozenset[str | None]] = {
    "duration": frozenset({"d", "h", "min", "s", "ms"}),
    "timestamp": frozenset({None}),
    "distance": _words("km m cm mm mi yd ft in"),
    "energy": _words("GJ kWh MJ MWh Wh"),
    "gas": _words("CCF ft³ m³"),
    "precipitation": _words("in cm mm"),
    "volume": _words("CCF ft³ m³ L mL gal") | {"fl. oz."},
    "water": _words("CCF ft³ m³ L gal"),
    "weight": _words("g kg mg oz lb st"),
}


def complaints(platform: str, payload: Mapping[str, Any]) -> list[str]:
    """Gives what Home Assistant would reject or drop of one entity's payload."""
    rules = PLATFORMS[platform]
    found = [f"{rules.source}: {key} is missing" for key in sorted(rules.required - set(payload))]
    found += [f"{rules.source}: unknown {key}" for key in sorted(set(payload) - rules.allowed)]
    for key, value in payload.items():
        found += [f"{rules.source}: {key}: {wrong}" for wrong in _wrong_value(platform, key, value)]
    found += [f"availability: {wrong}" for wrong in _wrong_availability(payload)]
    found += _wrong_together(payload)
    domain = str(payload.get("default_entity_id", platform)).partition(".")[0]
    if domain != platform:  # entity.py of 2026.11.0 warns of it
        found.append(f"default_entity_id is of {domain}, not of {platform}")
    return found


def device_complaints(device: Mapping[str, Any], origin: Mapping[str, Any]) -> list[str]:
    """Gives what Home Assistant would reject or drop of `device` and `origin`."""
    found = [f"device: unknown {key}" for key in sorted(set(device) - DEVICE_KEYS)]
    found += [f"origin: unknown {key}" for key in sorted(set(origin) - ORIGIN_KEYS)]
    if not device.get("identifiers"):
        found.append("device: no identifiers")
    if not origin.get("name"):
        found.append("origin: no name")
    return found


def _wrong_value(platform: str, key: str, value: object) -> Iterator[str]:
    expected = _expected_type(key)
    if key not in STRUCTURES and not isinstance(value, expected):
        yield f"{value!r} is no {getattr(expected, '__name__', 'number')}"
    if key in ENUMERATIONS and value not in ENUMERATIONS[key]:
        yield f"{value!r} is none of {sorted(ENUMERATIONS[key])}"
    if (key, value) == ("entity_category", "config") and platform in READ_ONLY_PLATFORMS:
        yield "what only shows something is no configuration"
    if key == "device_class" and value not in DEVICE_CLASSES.get(platform, ()):
        yield f"{value!r} is no class of {platform.replace('_', ' ')}s"
    if key.endswith("topic") and (not value or set("+#\0") & set(str(value))):
        yield f"{value!r} is no topic"  # util.py: valid_publish_topic


def _expected_type(key: str) -> type | UnionType:
    if key in BOOLEANS:
        return bool
    if key in NUMBERS:
        return int | float
    if key in INTEGERS:
        return int
    return list if key in LISTS else str


def _wrong_together(payload: Mapping[str, Any]) -> Iterator[str]:
    """Return the keys that do not fit each other, which each schema checks last."""
    device_class = str(payload.get("device_class"))
    unit = payload.get("unit_of_measurement")
    if device_class in UNITS and unit not in UNITS[device_class]:
        yield f"sensor.py: {unit} is no unit of {device_class}"
    if "options" in payload and not payload["options"]:
        yield "select.py: no options"
    bounds = [payload.get(key, default) for key, default in (("min", 1.0), ("max", 100.0))]
    if all(isinstance(bound, int | float) for bound in bounds) and bounds[0] >= bounds[1]:
        yield "number.py: min is not below max"  # validate_config


def _wrong_availability(payload: Mapping[str, Any]) -> Iterator[str]:
    if {"availability", "availability_topic"} <= set(payload):
        yield "the list and the single topic exclude each other"
    for entry in payload.get("availability", []):
        if not entry.get("topic"):
            yield "an entry without a topic"
        yield from (f"unknown {key}" for key in sorted(set(entry) - AVAILABILITY_KEYS))
