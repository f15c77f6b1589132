"""Tells which retained states are the bridge's own and not configured any more.

There is no file of what was ever published: the broker knows (docs/home-assistant.md). When
in doubt a topic is another program's and stays.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from bridge.config.names import is_id
from bridge.config.schema import Config
from bridge.model import CoverState
from bridge.mqtt import payloads
from bridge.mqtt.events import Subscription

_CHANNEL = re.compile(r"[1-9][0-9]?")
_SECONDS = re.compile(rb"[0-9]+\.[0-9]")
_COUNT = re.compile(rb"[0-9]+")
_PERCENT = re.compile(rb"[0-9]{1,3}")
_COVER_STATES = {state.value.encode() for state in CoverState}


def _object(payload: bytes) -> dict[str, Any]:
    try:
        document = json.loads(payload)
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def _is_availability(payload: bytes) -> bool:
    return payload in {payloads.ONLINE, payloads.OFFLINE}


def _is_value(payload: bytes) -> bool:
    return payload in {payloads.on_off(True), payloads.on_off(False)}


# What is retained below the base topic (docs/topics.md), and what its payload looks like.
# None of these filters matches a command: a broker may deliver a message once for each filter
# that it matches, and a command that comes twice is carried out twice.
_SHAPES: Mapping[str, Callable[[bytes], bool]] = {
    "+": lambda payload: set(_object(payload)) == {"di", "do"},
    "+/availability": _is_availability,
    "+/problem": lambda payload: "state" in _object(payload),
    "+/diagnostics": lambda payload: bool(_object(payload)),
    "+/di/+": _is_value,
    "+/di/+/count": lambda payload: _COUNT.fullmatch(payload) is not None,
    "+/do/+": _is_value,
    "+/do/+/mode": lambda payload: payload in {payloads.mode(True), payloads.mode(False)},
    "+/do/+/hold": lambda payload: _SECONDS.fullmatch(payload) is not None,
    "+/cover/+/state": lambda payload: payload in _COVER_STATES,
    "+/cover/+/position": lambda payload: _PERCENT.fullmatch(payload) is not None,
    "bridge/line/+/availability": _is_availability,
    "bridge/line/+/diagnostics": lambda payload: bool(_object(payload)),
}
# Another bridge may have its base topic below ours: these topics are its mark.
_NESTED_BRIDGES = tuple("/".join([*"+" * depth, "bridge/state"]) for depth in (1, 2, 3, 4))


class Leftovers:
    """The retained states of ours that `config` would not publish."""

    def __init__(self, config: Config) -> None:
        self._prefix = f"{config.mqtt.base_topic}/"
        self._lines = {line.id for line in config.lines}
        self._channels = {
            station.id: {
                "di": {str(channel.channel) for channel in station.inputs},
                "do": {str(output.channel) for output in station.outputs},
                "cover": {cover.id for cover in station.covers},
            }
            for _, station in config.all_stations
        }
        self._counted = {(station, str(channel)) for station, channel in config.counted}

    def subscriptions(self) -> list[Subscription]:
        """Return what to listen to for a moment in order to see them."""
        filters = (*_SHAPES, *_NESTED_BRIDGES)
        return [only_retained(f"{self._prefix}{one}") for one in filters]

    def concerns(self, topic: str) -> bool:
        """Return whether `among` needs to know of this topic."""
        if not topic.startswith(self._prefix):
            return False
        return topic.endswith("/bridge/state") or self._stray(topic) is not None

    def among(self, retained: Mapping[str, bytes]) -> list[str]:
        """Pick out what is to be cleared."""
        return [t for t, payload in retained.items() if self._is_one(t, payload, retained)]

    def _is_one(self, topic: str, payload: bytes, retained: Mapping[str, bytes]) -> bool:
        looks_like_ours = self._stray(topic)
        if looks_like_ours is None or not looks_like_ours(payload):
            return False
        return not self._is_anothers(topic, retained)

    def _is_anothers(self, topic: str, retained: Mapping[str, bytes]) -> bool:
        """Return whether it lies at or below the base topic of a bridge below ours."""
        levels = topic.removeprefix(self._prefix).split("/")
        bases = ("/".join(levels[: n + 1]) for n in range(len(levels)))
        return any(f"{self._prefix}{base}/bridge/state" in retained for base in bases)

    def _stray(self, topic: str) -> Callable[[bytes], bool] | None:
        """For a topic of our form that is not configured: the test of its payload."""
        if not topic.startswith(self._prefix):
            return None
        levels = topic.removeprefix(self._prefix).split("/")
        for shape, test in _SHAPES.items():
            if _fits(shape.split("/"), levels):
                return None if self._is_configured(levels) else test
        return None

    def _is_configured(self, levels: Sequence[str]) -> bool:
        match levels:
            case ["bridge", "line", line, _]:
                return line in self._lines
            case [station, "di", channel, "count"]:
                return (station, channel) in self._counted
            case [station, "di" | "do" | "cover" as kind, name, *_] if station in self._channels:
                return name in self._channels[station][kind]
        return levels[0] in self._channels


def only_retained(topic_filter: str) -> Subscription:
    """Return a subscription for what is retained now.

    The retain flag tells that from live messages.
    """
    # QoS 0: brokers bound what they queue of the others, and our commands are among those.
    return Subscription(topic_filter, qos=0, live_only=False, as_published=False)


def _fits(shape: Sequence[str], levels: Sequence[str]) -> bool:
    """Return whether a topic has this shape, with a name in the place of each `+`.

    The first is an id, the second a channel, or the id of a cover.
    """
    if len(shape) != len(levels):
        return False
    pairs = list(zip(shape, levels, strict=True))
    names = [level for want, level in pairs if want == "+"]
    if any(want not in {"+", level} for want, level in pairs):
        return False
    is_name = is_id if "cover" in shape else _CHANNEL.fullmatch
    return is_id(names[0]) and names[0] != "bridge" and all(map(is_name, names[1:]))
