"""Announces the devices to Home Assistant: retained messages, the bridge first.

See docs/home-assistant.md. Topics and ids never change: Home Assistant stores the settings of users
under them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any

from bridge import SUPPORT_URL, __version__
from bridge.config.schema import Config, LineConfig, StationConfig, WebConfig
from bridge.config.web import is_loopback
from bridge.mqtt.announce.entities import TRIGGER, Entity, bridge_entities, station_entities
from bridge.mqtt.announce.words import WORDS
from bridge.mqtt.events import OutMessage
from bridge.mqtt.payloads import as_json
from bridge.mqtt.topics import Topics

_BRIDGE = "bridge"  # no station can have this id
# The broker drops commands that are older than they are valid (docs/contract.md, promise 2). Home
# Assistant knows this key since it supports MQTT 5; older releases ignore it.
_EXPIRY = {"message_expiry_interval": 2}
_ORIGIN = {
    "name": "wisco2mqtt",
    "sw_version": __version__,
    **({"support_url": SUPPORT_URL} if SUPPORT_URL else {}),
}


@dataclass(frozen=True, slots=True)
class _Device:
    """One device as it is announced.

    Attributes:
        base: The base topic with `/` as `__`.
        name: The station's id, or `bridge`.
        info: What Home Assistant shows on the page of the device.
        commands: What goes for every entity that sends some.
    """

    base: str
    name: str
    info: dict[str, Any]
    entities: list[Entity]
    commands: dict[str, Any]

    @property
    def node_id(self) -> str:
        """Return the node id: in topics, and as identifier of the device."""
        return f"{self.base}__{self.name}"

    def component(self, entity: Entity) -> dict[str, Any]:
        """Return one entity with its ids; a trigger has none."""
        if entity.platform == TRIGGER:
            return entity.options
        object_id = f"{self.base}_{self.name}_{entity.object}"
        return {
            "unique_id": f"{self.node_id}__{entity.component_id}",
            # Both keys mean the same: each release of Home Assistant knows one of them and ignores
            # the other.
            "object_id": object_id,
            "default_entity_id": f"{entity.platform}.{object_id}",
            **(self.commands if "command_topic" in entity.options else {}),
            **entity.options,
        }


def discovery_messages(config: Config, protocol: str = "5") -> list[OutMessage]:
    """Return the announcements of everything configured, in the order in which to send them.

    Args:
        config: The configuration.
        protocol: The MQTT version of the connection: "5" or "3.1.1".
    """
    prefix = config.homeassistant.prefix
    # Home Assistant refuses to send commands with an expiry to a broker without MQTT 5.
    commands = _EXPIRY if protocol == "5" else {}
    devices = _devices(config, commands)
    match config.homeassistant.discovery:
        case "device":
            return [_as_device(prefix, device) for device in devices]
        case "single":
            return [message for device in devices for message in _as_singles(prefix, device)]
    return []


def node_prefix(config: Config) -> str:
    """Return the prefix of the node ids of a bridge: `a__`.

    The node ids of a bridge at `a/b` start with it too: `a__b__`.
    """
    return f"{config.mqtt.base_topic.replace('/', '__')}__"


def _as_device(prefix: str, device: _Device) -> OutMessage:
    components = {
        entity.component_id: {"platform": entity.platform, **device.component(entity)}
        for entity in device.entities
    }
    document = {"device": device.info, "origin": _ORIGIN, "components": components}
    return _retained(f"{prefix}/device/{device.node_id}/config", document)


def _as_singles(prefix: str, device: _Device) -> list[OutMessage]:
    return [
        _retained(
            f"{prefix}/{entity.platform}/{device.node_id}/{entity.component_id}/config",
            {
                "device": device.info,
                "origin": _ORIGIN,
                **device.component(entity),
                **entity.single_options,
            },
        )
        for entity in device.entities
    ]


def _retained(topic: str, document: dict[str, Any]) -> OutMessage:
    return OutMessage(topic, as_json(document), qos=1, retain=True)


def _devices(config: Config, commands: dict[str, Any]) -> Iterator[_Device]:
    """Yield the devices, the bridge first: the stations refer to it.

    One at a time, because a description is large until it is in its message.
    """
    bridge = _bridge(config, commands)
    yield bridge
    for line, station_config in config.all_stations:
        yield _station(config, bridge, line, station_config)


def _bridge(config: Config, commands: dict[str, Any]) -> _Device:
    base = node_prefix(config).removesuffix("__")
    info = {
        "identifiers": [f"{base}__{_BRIDGE}"],
        "name": "Wisco bridge",
        "manufacturer": "wisco2mqtt",
        "model": "MQTT bridge",
        "sw_version": __version__,
        **_link(config),
    }
    entities = bridge_entities(Topics(config.mqtt.base_topic), config.lines, config.rules)
    return _Device(base, _BRIDGE, info, entities, commands)


def _station(
    config: Config, bridge: _Device, line: LineConfig, station_config: StationConfig
) -> _Device:
    info = {
        "identifiers": [f"{bridge.base}__{station_config.id}"],
        "name": station_config.name,
        "manufacturer": "Wisco",
        "model": station_config.model.name,
        "serial_number": f"{line.id}, address {station_config.address}",
        "via_device": bridge.node_id,
        **({"suggested_area": station_config.area} if station_config.area else {}),
        **_link(config),
    }
    words = WORDS[config.homeassistant.language]
    ruled = any(
        order.station_id == station_config.id for rule in config.rules for order in rule.orders
    )
    topics = Topics(config.mqtt.base_topic)
    entities = station_entities(topics, line, station_config, words, ruled=ruled)
    return _Device(bridge.base, station_config.id, info, entities, bridge.commands)


def _link(config: Config) -> dict[str, Any]:
    """Return the "Visit" link of a device: as configured, else the panel."""
    url = config.homeassistant.configuration_url or _panel(config.web)
    return {"configuration_url": url} if url else {}


def _panel(web: WebConfig | None) -> str | None:
    """Return the address of the panel, if it is one that another machine can reach."""
    if web is None or is_loopback(web.host) or ip_address(web.host).is_unspecified:
        return None
    host = f"[{web.host}]" if ":" in web.host else web.host
    return f"http://{host}:{web.port}/"
