"""Announces the devices to Home Assistant: retained messages, the bridge's first.

docs/home-assistant.md. The names of topics and ids never change: Home Assistant keeps what
its users made of an entity under them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from bridge import __version__
from bridge.config.schema import Config, LineConfig, StationConfig
from bridge.mqtt.announce.entities import TRIGGER, Entity, bridge_entities, station_entities
from bridge.mqtt.events import OutMessage
from bridge.mqtt.payloads import as_json
from bridge.mqtt.topics import Topics

_BRIDGE = "bridge"  # no station can have this id
# Commands that the broker keeps for longer than they are valid (docs/contract.md, promise 2) lapse
# there already. Home Assistant knows the key since it speaks MQTT 5, and passes over it before.
_EXPIRY = {"message_expiry_interval": 2}
_ORIGIN = {"name": "wisco2mqtt", "sw_version": __version__}


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
        """Return what the device is known by: in topics, and as its identifier."""
        return f"{self.base}__{self.name}"

    def component(self, entity: Entity) -> dict[str, Any]:
        """Return one entity with its ids; a trigger has none."""
        if entity.platform == TRIGGER:
            return entity.options
        object_id = f"{self.base}_{self.name}_{entity.object}"
        return {
            "unique_id": f"{self.node_id}__{entity.component_id}",
            # The older and the newer key for one thing: a Home Assistant that knows one of
            # them ignores the other.
            "object_id": object_id,
            "default_entity_id": f"{entity.platform}.{object_id}",
            **(self.commands if "command_topic" in entity.options else {}),
            **entity.options,
        }


def discovery_messages(config: Config, protocol: str = "5") -> list[OutMessage]:
    """Give what announces everything that is configured, in the order in which to send it.

    Args:
        config: What is there.
        protocol: The MQTT that the broker speaks: "5" or "3.1.1".
    """
    prefix = config.homeassistant.prefix
    # Home Assistant refuses to send a command with an expiry to a broker that knows none.
    commands = _EXPIRY if protocol == "5" else {}
    devices = _devices(config, commands)
    match config.homeassistant.discovery:
        case "device":
            return [_as_device(prefix, device) for device in devices]
        case "single":
            return [message for device in devices for message in _as_singles(prefix, device)]
    return []


def node_prefix(config: Config) -> str:
    """Return what the node ids of a bridge begin with: `a__`. Those of one at `a/b` do too.

    `a__b__`.
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
            {"device": device.info, "origin": _ORIGIN, **device.component(entity)},
        )
        for entity in device.entities
    ]


def _retained(topic: str, document: dict[str, Any]) -> OutMessage:
    return OutMessage(topic, as_json(document), qos=1, retain=True)


def _devices(config: Config, commands: dict[str, Any]) -> Iterator[_Device]:
    """Yield the bridge first: the stations name it as what they are reached through.

    One at a time, since what describes a device is large until it is put into its message.
    """
    bridge = _bridge(config, commands)
    yield bridge
    for line, station in config.all_stations:
        yield _station(config, bridge, line, station)


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
    entities = bridge_entities(Topics(config.mqtt.base_topic), config.lines)
    return _Device(base, _BRIDGE, info, entities, commands)


def _station(config: Config, bridge: _Device, line: LineConfig, station: StationConfig) -> _Device:
    info = {
        "identifiers": [f"{bridge.base}__{station.id}"],
        "name": station.name,
        "manufacturer": "Wisco",
        "model": station.model.name,
        "via_device": bridge.node_id,
        **({"suggested_area": station.area} if station.area else {}),
        **_link(config),
    }
    entities = station_entities(Topics(config.mqtt.base_topic), line, station)
    return _Device(bridge.base, station.id, info, entities, bridge.commands)


def _link(config: Config) -> dict[str, Any]:
    url = config.homeassistant.configuration_url
    return {"configuration_url": url} if url else {}
