"""The bytes of every payload that the bridge publishes (docs/topics.md)."""

import json
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from bridge.config.schema import Config, LineConfig, StationConfig
from bridge.model import CoverChanged, CoverState, Gesture, Verdict

ONLINE = b"online"
OFFLINE = b"offline"
UNKNOWN = b"None"  # Home Assistant takes a state for unknown
CLEARED = b""  # an empty retained message clears the topic


def as_json(document: Mapping[str, Any]) -> bytes:
    """Return compact JSON in UTF-8."""
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"))
    # A lone surrogate (`"\ud800"` is valid JSON and YAML) has no UTF-8 form: it becomes `?`.
    return text.encode("utf-8", errors="replace")


def on_off(on: bool) -> bytes:
    """Return ON or OFF."""
    return b"ON" if on else b"OFF"


def availability(online: bool) -> bytes:
    """Return `online` or `offline`."""
    return ONLINE if online else OFFLINE


def mode(pulse: bool) -> bytes:
    """Return `pulse` or `latch`."""
    return b"pulse" if pulse else b"latch"


def hold(hold_ds: int) -> bytes:
    """Return a hold time in seconds, with one decimal."""
    return f"{hold_ds // 10}.{hold_ds % 10}".encode()


def gesture(gesture: Gesture) -> bytes:
    """Return the event of a press."""
    return as_json({"event_type": gesture})


def rule_event(held: str | None) -> bytes:
    """Return that a rule acts, or what holds it."""
    if held is None:
        return as_json({"event_type": "fired"})
    return as_json({"event_type": "held", "detail": held})


def count(edges: int) -> bytes:
    """Return the number of edges, without their factor."""
    return str(edges).encode()


def position(percent: int | None) -> bytes:
    """Return the position of a cover; empty if it is not known."""
    return CLEARED if percent is None else str(percent).encode()


def cover_state(changed: CoverChanged) -> bytes:
    """Return the state of a cover; `None` if it stands and its position is not known."""
    is_unknown = changed.state is CoverState.STOPPED and changed.position is None
    return UNKNOWN if is_unknown else changed.state.value.encode()


def snapshot(config: StationConfig, inputs: int, outputs: int) -> bytes:
    """Return all channels of a module that are not left out."""
    return as_json(
        {
            "di": {str(c.channel): _word(inputs, c.channel) for c in config.inputs},
            "do": {str(c.channel): _word(outputs, c.channel) for c in config.outputs},
        }
    )


def _word(bits: int, channel: int) -> str:
    return "ON" if bits >> (channel - 1) & 1 else "OFF"


def problem(reason: str, detail: str, since: datetime) -> bytes:
    """Return a problem; `since` has a time zone."""
    stamp = since.isoformat(timespec="seconds")
    return as_json({"state": "ON", "reason": reason, "detail": detail, "since": stamp})


def no_problem() -> bytes:
    """Return that there is no problem."""
    return as_json({"state": "OFF"})


def verdict(verdict: Verdict) -> bytes:
    """Return a verdict."""
    return as_json(verdict_fields(verdict))


def verdict_fields(verdict: Verdict) -> dict[str, Any]:
    """Return the fields of a verdict; those without a value are left out."""
    document = {
        "target": verdict.target,
        "payload": verdict.payload,
        "id": verdict.id,
        "status": verdict.status,
        "reason": verdict.reason,
        "ms": verdict.ms,
        "code": verdict.code,
        "seen_on": verdict.seen_on,
        "detail": verdict.detail,
        "by": verdict.by,
    }
    return {key: value for key, value in document.items() if value is not None}


def log_line(level: str, message: str, line: str | None, station_id: str | None) -> bytes:
    """Return one warning or error of the bridge."""
    places = {"line": line, "station": station_id}
    where = {key: value for key, value in places.items() if value is not None}
    return as_json({"level": level, "message": message, **where})


def bridge_info(config: Config, version: str, started: datetime, protocol: str) -> bytes:
    """Return version and lines. Ports and broker are left out: addresses may hold credentials."""
    return as_json(
        {
            "version": version,
            "started": started.isoformat(timespec="seconds"),
            "protocol": protocol,
            "lines": [_line_info(line) for line in config.lines],
        }
    )


def _line_info(line: LineConfig) -> dict[str, Any]:
    stations = [_station_info(config) for config in line.stations]
    return {"id": line.id, "protocol": line.protocol, "baud": line.baud, "stations": stations}


def _station_info(config: StationConfig) -> dict[str, Any]:
    return {
        "id": config.id,
        "name": config.name,
        "model": config.model.name,
        "address": config.address,
    }
