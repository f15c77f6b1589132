"""Figures of lines and stations from the diagnostics topics; disabled by default."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from bridge.config.schema import LineConfig
from bridge.mqtt.announce.entities.entity import Entity, Origin, availability, connectivity
from bridge.mqtt.topics import Topics

_OFF_BY_DEFAULT = {"entity_category": "diagnostic", "enabled_by_default": False}
_MILLISECONDS = {
    "device_class": "duration",
    "state_class": "measurement",
    "unit_of_measurement": "ms",
}
_ERRORS = "value_json.counters.silent + value_json.counters.bad + value_json.counters.refused"


def entities(place: Origin) -> Iterator[Entity]:
    """Yield poll time, reply time, errors and last reply of a station."""
    source = _Figures(place.topics.diagnostics(place.config.id), place.truth)
    yield source.sensor("poll_time", "Poll time", "value_json.poll_ms.p50", _MILLISECONDS)
    yield source.sensor("reply_time", "Reply time", "value_json.reply_ms.p50", _MILLISECONDS)
    counted = {
        "state_class": "total_increasing",
        "json_attributes_topic": source.topic,
        "json_attributes_template": (
            "{{ dict(value_json.counters, last_error=value_json.last_error) | to_json }}"
        ),
    }
    yield source.sensor("errors", "Errors", _ERRORS, counted)
    instant = {"device_class": "timestamp"}
    yield source.sensor("last_seen", "Last seen", "value_json.last_seen", instant)


def of_line(topics: Topics, line: LineConfig) -> Iterator[Entity]:
    """Yield the port of a line, the time of its cycle, and its utilisation."""
    subject, name = f"line_{line.id}", f"Line {line.id}"
    port = topics.line_availability(line.id)
    yield connectivity(topics, port, f"{subject}_connectivity", f"{name} connection")
    source = _Figures(topics.line_diagnostics(line.id), availability(topics.bridge_state, port))
    cycle = "value_json.cycle_ms.p50"
    yield source.sensor(f"{subject}_cycle", f"{name} cycle", cycle, _MILLISECONDS)
    percent = "(value_json.utilisation * 100) | round(1)"
    share = {"state_class": "measurement", "unit_of_measurement": "%"}
    yield source.sensor(f"{subject}_utilisation", f"{name} utilisation", percent, share)


@dataclass(frozen=True, slots=True)
class _Figures:
    """A diagnostics topic, and its availability."""

    topic: str
    truth: dict[str, Any]

    def sensor(self, subject: str, name: str, value: str, kind: dict[str, Any]) -> Entity:
        """Return the sensor of one figure; `value` is its path in the JSON."""
        options = {
            "name": name,
            "state_topic": self.topic,
            "value_template": f"{{{{ {value} }}}}",
            **kind,
            **_OFF_BY_DEFAULT,
            **self.truth,
        }
        return Entity(subject, "sensor", options)
