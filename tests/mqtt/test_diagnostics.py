import json
from dataclasses import replace
from datetime import datetime, timedelta, timezone

from bridge.model import ExchangeCounts, Learned, LineMeasured, Spread, StationMeasured
from bridge.mqtt import diagnostics

COUNTS = ExchangeCounts(good=1000, silent=2, bad=1, refused=3)
LINE = LineMeasured("main", Spread(0.0912, 0.10349), 0.98765, COUNTS, 7)
STATION = StationMeasured(
    station_id="garage",
    poll=Spread(0.0912, 0.1201),
    reply=Spread(0.021, 0.0224),
    bound_s=0.11,
    age_s=0.13,
    counts=COUNTS,
    last_error="station 1 did not answer within 0.12 s",
    last_seen=5.0,
)
SEEN = datetime(2024, 5, 1, 12, 0, 0, 123456, timezone(timedelta(hours=7)))


def test_a_line() -> None:
    """Times in milliseconds, a share from 0 to 1, and counters."""
    assert json.loads(diagnostics.of_line(LINE)) == {
        "cycle_ms": {"p50": 91.2, "p99": 103.5},
        "utilisation": 0.988,
        "counters": {"good": 1000, "silent": 2, "bad": 1, "refused": 3, "unsolicited_bytes": 7},
    }


def test_a_station() -> None:
    """The bound is beside the measured times; the last reply has a time with zone."""
    assert json.loads(diagnostics.of_station(STATION, SEEN)) == {
        "poll_ms": {"p50": 91.2, "p99": 120.1},
        "bound_ms": 110.0,
        "age_ms": 130.0,
        "reply_ms": {"p50": 21.0, "p99": 22.4},
        "counters": {"good": 1000, "silent": 2, "bad": 1, "refused": 3},
        "last_error": "station 1 did not answer within 0.12 s",
        "last_seen": "2024-05-01T12:00:00.123+07:00",
    }


def test_the_times_that_were_learned() -> None:
    """Only those that the configuration leaves to the bridge are shown."""
    told = diagnostics.of_station(replace(STATION, learned=Learned(0.2125, None, 0.0035)), SEEN)
    assert json.loads(told)["learned"] == {"turnaround_ms": 212.5, "silence_ms": 3.5}


def test_what_was_not_measured_is_null() -> None:
    """Every key is there all the same, so that a template that reads it finds it."""
    line = LineMeasured("main", None, 0.0, ExchangeCounts(0, 0, 0, 0), 0)
    counts = ExchangeCounts(0, 0, 0, 0)
    station = StationMeasured("garage", None, None, 0.11, None, counts, None, None)
    assert json.loads(diagnostics.of_line(line))["cycle_ms"] == {"p50": None, "p99": None}
    told = json.loads(diagnostics.of_station(station, None))
    assert told.keys() == json.loads(diagnostics.of_station(STATION, SEEN)).keys()
    assert told["poll_ms"] == told["reply_ms"] == {"p50": None, "p99": None}
    assert [told[key] for key in ("age_ms", "last_error", "last_seen")] == [None] * 3
