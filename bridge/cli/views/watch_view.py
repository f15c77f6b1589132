"""How `watch` tells what the bridge publishes: a line a change, in words."""

import re
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

from bridge.cli.views.verdict_words import outcome
from bridge.config.schema import Config
from bridge.mqtt.events import Received
from bridge.mqtt.strict_json import object_of

_RED, _GREEN, _YELLOW, _DIM, _PLAIN = "\x1b[31m", "\x1b[32m", "\x1b[33m", "\x1b[2m", "\x1b[0m"
_COLOURS = {
    "ON": _GREEN,
    "online": _GREEN,
    "OFF": _DIM,
    "offline": _RED,
    "problem": _RED,
    "warning": _YELLOW,
    "error": _RED,
    "failed": _RED,
    "unknown": _RED,
    "refused": _YELLOW,
}
_KINDS = {"di": "input", "do": "output"}
_WHO_CHARS = 8  # at the least
_WHAT_CHARS = 20


class MessageWords:
    """Tells each message in words, with the names of a configuration where there is one."""

    def __init__(self, config: Config | None, base: str, *, colour: bool) -> None:
        self._prefix = f"{base}/"
        self._colour = colour
        stations = [s for line in config.lines for s in line.stations] if config else []
        self._names = {
            (station_config.id, kind, str(channel.channel)): channel.name
            for station_config in stations
            for kind, channels in (("di", station_config.inputs), ("do", station_config.outputs))
            for channel in channels
            if channel.name
        }
        self._who_chars = max(_WHO_CHARS, *(len(s.id) for s in stations)) if stations else 8
        names = [len(name) for name in self._names.values()]
        self._what_chars = max([_WHAT_CHARS, *(len("output 16 ") + size for size in names)])

    def line(self, message: Received, now: datetime) -> str | None:
        """Return the line of a message; None: it tells no change."""
        told = self._told(message)
        if told is None:
            return None
        who, what, value = (printable(part) for part in told)
        text = f"{now:%H:%M:%S} {who:<{self._who_chars}}  {what:<{self._what_chars}}  "
        return text + self._coloured(value)

    def _told(self, message: Received) -> tuple[str, str, str] | None:
        who, *below = message.topic.removeprefix(self._prefix).split("/")
        payload = message.payload.decode(errors="replace")
        match below:
            case ["di" | "do" as kind, channel, *rest]:
                return self._channel(who, kind, channel, rest, payload)
            case ["availability"]:
                return who, "", payload
            case ["state"] if who == "bridge":
                return who, "", payload
            case ["line", line, "availability"] if who == "bridge":
                return who, f"line {line}", payload
            case ["cover", cover, "state" | "position" as rest]:
                return who, f"cover {cover}", payload if rest == "state" else f"at {payload} %"
        return _documented(who, below, payload)

    def _channel(
        self, who: str, kind: str, channel: str, rest: list[str], payload: str
    ) -> tuple[str, str, str] | None:
        name = self._names.get((who, kind, channel), "")
        what = f"{_KINDS[kind]} {channel} {name}".rstrip()
        match rest:
            case []:
                return who, what, payload
            case ["mode"]:
                return who, what, f"mode {payload}"
            case ["hold"]:
                return who, what, f"hold time {payload} s"
            case ["count"]:
                return who, what, f"counted {payload}"
            case ["event"]:
                return who, what, f"{object_of(payload).get('event_type')} press"
        return None

    def _coloured(self, value: str) -> str:
        word = re.split(r"[:, ]", value, maxsplit=1)[0]
        colour = _COLOURS.get(word, "") if self._colour else ""
        return f"{colour}{value}{_PLAIN}" if colour else value


def _documented(who: str, below: list[str], payload: str) -> tuple[str, str, str] | None:
    """Tell what comes as JSON: problems, verdicts, the log."""
    tell: Mapping[str, Callable[[Mapping[str, Any]], tuple[str, str]]] = {
        "problem": lambda told: ("", _problem(told)),
        "result": lambda told: (f"{told.get('target')} {_asked(told)}", outcome(told)),
        "log": lambda told: ("", f"{told.get('level')}: {told.get('message')}"),
    }
    if len(below) != 1 or below[0] not in tell:
        return None
    return who, *tell[below[0]](object_of(payload))


def _problem(told: Mapping[str, Any]) -> str:
    if told.get("state") != "ON":
        return "no problem"
    return f"problem: {told.get('reason')}: {told.get('detail')}"


def _asked(told: Mapping[str, Any]) -> str:
    asked = told.get("payload")
    if not isinstance(asked, dict):
        return str(asked)
    several = asked["do"] if isinstance(asked.get("do"), dict) else asked
    return ",".join(f"{channel}={word}" for channel, word in several.items())


def printable(text: str) -> str:
    """Anyone may write to a broker: no payload shall break a line or steer a terminal."""
    return "".join(one if one.isprintable() else f"\\x{ord(one):02x}" for one in text)
