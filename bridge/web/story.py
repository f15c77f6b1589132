"""Makes documents for the board of what the hub publishes.

Only the main thread calls it, except for `logged`.

An instant in a document is in seconds of `bridge.clock.boot_s`, and the browser shows it by its own
clock: the one of the bridge may be wrong (docs/failures.md F21).
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, assert_never

from bridge.config.current import CurrentConfig
from bridge.model import (
    CountChanged,
    CoverChanged,
    GestureMade,
    LineChanged,
    LineMeasured,
    ProblemChanged,
    PublicEvent,
    RuleFired,
    RuleSwitched,
    SettingsRead,
    StationChanged,
    StationMeasured,
    ValuesChanged,
    Verdict,
    channels_of,
)
from bridge.mqtt import diagnostics, payloads
from bridge.web.board import BACKUP_KEY, SCAN_KEY, Board
from bridge.web.house import house

_OfStation = (
    StationChanged
    | ValuesChanged
    | SettingsRead
    | CoverChanged
    | CountChanged
    | ProblemChanged
    | StationMeasured
)


@dataclass(slots=True)
class _StationStory:
    """What is known of a module."""

    online: bool = False
    detail: str = ""
    bits: dict[str, int] = field(default_factory=dict)  # by "di" and "do"; empty: never read
    changed_at: dict[str, dict[int, float]] = field(default_factory=lambda: {"di": {}, "do": {}})
    modes: dict[str, Any] | None = None
    covers: dict[str, Any] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    problem: dict[str, Any] | None = None
    measured: Mapping[str, Any] | None = None

    def document(self) -> dict[str, Any]:
        return {
            "online": self.online,
            "detail": self.detail,
            "di": self._channels("di"),
            "do": self._channels("do"),
            "settings": self.modes,
            "covers": dict(self.covers),
            "counts": dict(self.counts),
            "problem": self.problem,
            "diagnostics": self.measured,
        }

    def _channels(self, way: str) -> dict[str, Any] | None:
        """Return the bits, and when each changed last; None: they were never read."""
        if way not in self.bits:
            return None
        at = {str(channel): round(at, 3) for channel, at in self.changed_at[way].items()}
        return {"on": list(channels_of(self.bits[way])), "at": at}


class Story:
    """Keeps what is known, and tells the board what is new of it."""

    def __init__(self, board: Board, clock: Callable[[], float]) -> None:
        """Args: `clock` is `bridge.clock.boot_s`."""
        self._board = board
        self._clock = clock
        self._stations: dict[str, _StationStory] = {}
        self._lines: dict[str, dict[str, Any]] = {}
        self._current: CurrentConfig | None = None
        self._config: object = None

    def follow(self, current: CurrentConfig) -> None:
        """Tell of what is configured, if that is new."""
        self._current = current
        if current.config is self._config:
            return
        config = self._config = current.config
        self._stations = {
            name: self._stations.get(name, _StationStory()) for name in current.stations
        }
        lines = [line.id for line in config.lines]
        self._lines = {name: self._lines.get(name, _new_line()) for name in lines}
        kept = [f"line/{name}" for name in lines] + [f"station/{name}" for name in self._stations]
        self._board.keep({*kept, "bridge", SCAN_KEY, BACKUP_KEY})
        self._board.put("house", house(config))
        for line in self._lines:
            self._tell_line(line)
        for station_id in self._stations:
            self._tell_station(station_id)

    def hear(self, event: PublicEvent) -> None:
        """Take what the hub publishes."""
        match event:
            case LineChanged() | LineMeasured():
                self._hear_line(event)
            case Verdict():
                self._happened("verdict", event.station_id, **verdict_document(event))
            case GestureMade(station_id, channel, gesture):
                self._happened("gesture", station_id, target=f"di/{channel}", state=gesture)
            case RuleFired(rule, held):
                self._happened("rule", rule, state="held" if held else "fired", detail=held or "")
            case RuleSwitched(rule, on):
                self._happened("rule", rule, state=payloads.on_off(on).decode())
            case _:
                # Else its line ends just now: it is not configured any more.
                if event.station_id in self._stations:
                    self._hear_station(event)
                    self._tell_station(event.station_id)

    def logged(self, level: str, message: str, where: str) -> None:
        """Take a warning or an error of the bridge. Any thread may call it."""
        self._happened("log", where, level=level, message=message)

    def traced(self, line: str, at: float, heard: Mapping[str, Any]) -> None:
        """Take what passed on a line, decoded."""
        self._board.note("trace", {"at": round(at, 4), "line": line, **heard})

    def _hear_station(self, event: _OfStation) -> None:
        match event:
            case StationChanged(_, online, detail):
                self._turn(event.station_id, online=online, detail=detail)
            case ValuesChanged(_, inputs, outputs):
                self._values(event.station_id, {"di": inputs, "do": outputs})
            case SettingsRead():
                self._stations[event.station_id].modes = _settings(event)
            case CoverChanged(_, cover, state, position):
                self._stations[event.station_id].covers[cover] = {
                    "state": state,
                    "position": position,
                }
            case CountChanged(_, channel, edges):
                self._stations[event.station_id].counts[str(channel)] = edges
            case ProblemChanged(_, reason, detail):
                self._problem(event.station_id, reason, detail)
            case StationMeasured():
                self._stations[event.station_id].measured = _of_station(event)
            case _:
                assert_never(event)

    def _hear_line(self, event: LineChanged | LineMeasured) -> None:
        line = self._lines.get(event.line)
        if line is None:
            return
        if isinstance(event, LineChanged):
            if line["online"] != event.online:
                state = "online" if event.online else "offline"
                self._happened("line", event.line, state=state, detail=event.detail)
            line |= {"online": event.online, "detail": event.detail}
        else:
            line["diagnostics"] = json.loads(diagnostics.of_line(event))
            line["hour"] = [*line["hour"], _point(event, self._clock())][-60:]
        self._tell_line(event.line)

    def _turn(self, name: str, *, online: bool, detail: str) -> None:
        station = self._stations[name]
        if station.online != online:
            state = "online" if online else "offline"
            self._happened("station", name, state=state, detail=detail)
        station.online, station.detail = online, detail

    def _values(self, name: str, now: dict[str, int]) -> None:
        station, at = self._stations[name], self._clock()
        before, station.bits = station.bits, now
        if not before:
            return  # the first values are no changes
        for way, bits in now.items():
            for channel in channels_of(bits ^ before[way]):
                station.changed_at[way][channel] = at
                state = payloads.on_off(bool(bits >> (channel - 1) & 1)).decode()
                self._happened("value", name, target=f"{way}/{channel}", state=state)

    def _problem(self, name: str, reason: str | None, detail: str) -> None:
        station = self._stations[name]
        known = station.problem and station.problem["reason"]
        if known != reason:
            self._happened(
                "problem", name, state="ON" if reason else "OFF", reason=reason, detail=detail
            )
        if reason is None:
            station.problem = None
            return
        since = station.problem["since"] if station.problem and known == reason else self._clock()
        station.problem = {"reason": reason, "detail": detail, "since": since}

    def _happened(self, kind: str, where: str, **more: Any) -> None:
        at = round(self._clock(), 3)
        self._board.note("happened", {"at": at, "kind": kind, "where": where, **more})

    def _tell_line(self, line: str) -> None:
        self._board.put(f"line/{line}", dict(self._lines[line]))

    def _tell_station(self, station_id: str) -> None:
        self._board.put(f"station/{station_id}", self._stations[station_id].document())


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict as the clients of the broker get it."""
    return dict(json.loads(payloads.verdict(verdict)))


def _new_line() -> dict[str, Any]:
    return {"online": False, "detail": "", "diagnostics": None, "hour": []}


def _point(event: LineMeasured, now: float) -> dict[str, Any]:
    """Return what the curve of the last hour shows."""
    cycle = None if event.cycle is None else round(event.cycle.p50_s * 1000, 1)
    return {"at": round(now), "cycle": cycle, "utilisation": round(event.utilisation, 3)}


def _settings(event: SettingsRead) -> dict[str, Any] | None:
    if event.settings is None:
        return None
    return {
        "pulse": list(channels_of(event.settings.pulse)),
        "hold": [hold_ds / 10 for hold_ds in event.settings.hold_ds],
    }


def _of_station(event: StationMeasured) -> dict[str, Any]:
    return {**json.loads(diagnostics.of_station(event, None)), "last_seen": event.last_seen}
