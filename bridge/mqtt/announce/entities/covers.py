"""Covers: one entity each, in place of switches for the two outputs."""

from collections.abc import Iterator

from bridge.config.schema import CoverConfig
from bridge.mqtt.announce.entities.entity import Entity, Origin

# Releases before 2024.11 warn of a state `None`. They pass over an empty one.
_NO_NONE = {"value_template": "{{ '' if value == 'None' else value }}"}


def entities(place: Origin) -> Iterator[Entity]:
    """Yield the covers of a station."""
    yield from (_cover(place, cover) for cover in place.config.covers)


def _cover(place: Origin, cover: CoverConfig) -> Entity:
    """Return the entity of a cover.

    The keys are those of homeassistant/components/mqtt/cover.py.
    """
    topics, station_id = place.topics, place.config.id
    position_topic = topics.cover_position(station_id, cover.id)
    options = {
        "name": cover.name,
        "command_topic": topics.cover_commands(station_id, cover.id),
        "payload_open": "OPEN",
        "payload_close": "CLOSE",
        "payload_stop": "STOP",
        "state_topic": topics.cover_state(station_id, cover.id),
        "state_open": "open",
        "state_opening": "opening",
        "state_closed": "closed",
        "state_closing": "closing",
        "state_stopped": "stopped",
        "position_topic": position_topic,
        "set_position_topic": f"{position_topic}/set",
        "position_open": 100,
        "position_closed": 0,
        "optimistic": False,
        "qos": 1,
        **({"device_class": cover.device_class} if cover.device_class else {}),
        **place.truth,
    }
    return Entity(f"cover_{cover.id}", "cover", options, _NO_NONE)
