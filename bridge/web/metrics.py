"""The figures as OpenMetrics text, for Prometheus and the like."""

from collections.abc import Iterator, Mapping
from typing import Any

_RESULTS = ("good", "silent", "bad", "refused")


def metrics(states: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the figures of everything on the board, by its keys."""
    lines = {key[5:]: state for key, state in states.items() if key.startswith("line/")}
    stations = {key[8:]: state for key, state in states.items() if key.startswith("station/")}
    bridge = states.get("bridge", {})
    broker = [("", bridge.get("broker") == "online")]
    bounds, ages = _ms("bound_ms", stations), _ms("age_ms", stations)
    families = (
        ("broker_up", "gauge", "The broker answers.", broker),
        ("line_up", "gauge", "The port of a line is open.", _online("line", lines)),
        ("station_up", "gauge", "A module answers.", _online("station", stations)),
        ("line_cycle_seconds", "gauge", "One round of a line.", _cycles(lines)),
        ("line_utilisation", "gauge", "The share of time in exchanges.", _busy(lines)),
        ("exchanges", "counter", "Exchanges by their result.", _exchanges(stations)),
        ("station_bound_seconds", "gauge", "The longest age there should be.", bounds),
        ("station_age_seconds", "gauge", "The longest age there was.", ages),
        ("commands", "counter", "Commands by their verdict.", _commands(bridge)),
    )
    return "".join(_family(*family) for family in families) + "# EOF\n"


Sample = tuple[str, float | bool]


def _family(name: str, kind: str, told: str, samples: list[Sample]) -> str:
    full = f"wisco2mqtt_{name}"
    suffix = "_total" if kind == "counter" else ""
    head = f"# TYPE {full} {kind}\n# HELP {full} {told}\n"
    return head + "".join(f"{full}{suffix}{labels} {float(value)!r}\n" for labels, value in samples)


def _online(label: str, states: Mapping[str, Any]) -> list[Sample]:
    return [(f'{{{label}="{name}"}}', state["online"]) for name, state in states.items()]


def _measured(states: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    return ((n, s["diagnostics"]) for n, s in states.items() if s["diagnostics"] is not None)


def _cycles(lines: Mapping[str, Any]) -> list[Sample]:
    return [
        (f'{{line="{line}",quantile="{quantile}"}}', figures["cycle_ms"][key] / 1000)
        for line, figures in _measured(lines)
        for key, quantile in (("p50", "0.5"), ("p99", "0.99"))
        if figures["cycle_ms"][key] is not None
    ]


def _busy(lines: Mapping[str, Any]) -> list[Sample]:
    return [(f'{{line="{line}"}}', figures["utilisation"]) for line, figures in _measured(lines)]


def _exchanges(stations: Mapping[str, Any]) -> list[Sample]:
    return [
        (f'{{station="{station_id}",result="{result}"}}', figures["counters"][result])
        for station_id, figures in _measured(stations)
        for result in _RESULTS
    ]


def _ms(key: str, stations: Mapping[str, Any]) -> list[Sample]:
    return [
        (f'{{station="{station_id}"}}', figures[key] / 1000)
        for station_id, figures in _measured(stations)
        if figures[key] is not None
    ]


def _commands(bridge: Mapping[str, Any]) -> list[Sample]:
    counted = bridge.get("commands", {})
    return [(f'{{status="{status}"}}', number) for status, number in sorted(counted.items())]
