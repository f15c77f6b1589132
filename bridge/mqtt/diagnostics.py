"""The payloads of the diagnostics topics (docs/topics.md): times in ms, counts since start."""

from dataclasses import asdict
from datetime import datetime

from bridge.model import Learned, LineMeasured, Spread, StationMeasured
from bridge.mqtt.payloads import as_json


def of_line(measured: LineMeasured) -> bytes:
    """Return the figures of a line."""
    return as_json(
        {
            "cycle_ms": _spread(measured.cycle),
            "utilisation": round(measured.utilisation, 3),
            "counters": {
                **asdict(measured.counts),
                "unsolicited_bytes": measured.unsolicited_bytes,
            },
        }
    )


def of_station(measured: StationMeasured, last_seen: datetime | None) -> bytes:
    """Return the figures of a module; `last_seen` has a time zone."""
    return as_json(
        {
            "poll_ms": _spread(measured.poll),
            "bound_ms": _ms(measured.bound_s),
            "age_ms": _ms(measured.age_s),
            "reply_ms": _spread(measured.reply),
            **_learned(measured.learned),
            "counters": asdict(measured.counts),
            "last_error": measured.last_error,
            "last_seen": last_seen and last_seen.isoformat(timespec="milliseconds"),
        }
    )


def _learned(learned: Learned) -> dict[str, dict[str, float | None]]:
    times = {
        "turnaround_ms": learned.turnaround_s,
        "late_window_ms": learned.late_window_s,
        "silence_ms": learned.silence_s,
    }
    known = {name: _ms(seconds) for name, seconds in times.items() if seconds is not None}
    return {"learned": known} if known else {}


def _spread(spread: Spread | None) -> dict[str, float | None]:
    # Without a value the keys remain, because templates read them.
    if spread is None:
        return {"p50": None, "p99": None}
    return {"p50": _ms(spread.p50_s), "p99": _ms(spread.p99_s)}


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds * 1000, 1)
