"""Finds retained states of ours that are not configured any more.

There is no file of published topics: the broker has them (docs/home-assistant.md). A topic that may
belong to another program is kept.
"""

import re
from collections.abc import Callable, Mapping, Sequence

from bridge.config.names import is_id
from bridge.config.schema import Config
from bridge.model import CoverState
from bridge.mqtt import payloads
from bridge.mqtt.events import Subscription
from bridge.mqtt.strict_json import object_of

_CHANNEL = re.compile(r"[1-9][0-9]?")
_SECONDS = re.compile(rb"[0-9]+\.[0-9]")
_COUNT = re.compile(rb"[0-9]+")
_PERCENT = re.compile(rb"[0-9]{1,3}")
_COVER_STATES = {payloads.UNKNOWN, *(state.value.encode() for state in CoverState)}


def _is_availability(payload: bytes) -> bool:
    return payload in {payloads.ONLINE, payloads.OFFLINE}


def _is_value(payload: bytes) -> bool:
    return payload in {payloads.on_off(True), payloads.on_off(False)}


# The topics below the base topic (docs/topics.md) that are retained, and the form of their payload.
# None of these filters matches a command: a broker may deliver a message once for each matching
# filter, and a command that arrives twice would be carried out twice.
_SHAPES: Mapping[str, Callable[[bytes], bool]] = {
    "+": lambda payload: set(object_of(payload)) == {"di", "do"},
    "+/availability": _is_availability,
    "+/problem": lambda payload: "state" in object_of(payload),
    "+/own_actions": lambda payload: set(object_of(payload)) == {"last", "actions"},
    "+/diagnostics": lambda payload: bool(object_of(payload)),
    "+/di/+": _is_value,
    "+/di/+/count": lambda payload: _COUNT.fullmatch(payload) is not None,
    "+/do/+": _is_value,
    "+/do/+/mode": lambda payload: payload in {payloads.mode(True), payloads.mode(False)},
    "+/do/+/hold": lambda payload: _SECONDS.fullmatch(payload) is not None,
    "+/cover/+/state": lambda payload: payload in _COVER_STATES,
    "+/cover/+/position": lambda payload: _PERCENT.fullmatch(payload) is not None,
    "bridge/rule/+/state": _is_value,
    "bridge/line/+/availability": _is_availability,
    "bridge/line/+/diagnostics": lambda payload: bool(object_of(payload)),
}
# Another bridge may have its base topic below ours: these topics identify it.
_NESTED_BRIDGES = tuple("/".join([*"+" * depth, "bridge/state"]) for depth in (1, 2, 3, 4))


class Leftovers:
    """The retained states of ours that `config` does not publish."""

    def __init__(self, config: Config) -> None:
        self._prefix = f"{config.mqtt.base_topic}/"
        self._lines = {line.id for line in config.lines}
        self._rules = {rule.id for rule in config.rules}
        self._channels = {
            station_config.id: {
                "di": {str(channel.channel) for channel in station_config.inputs},
                "do": {str(output.channel) for output in station_config.outputs},
                "cover": {cover.id for cover in station_config.covers},
            }
            for _, station_config in config.all_stations
        }
        self._counted = {(station_id, str(channel)) for station_id, channel in config.counted}

    def subscriptions(self) -> list[Subscription]:
        """Return the subscriptions with which these topics are read."""
        filters = (*_SHAPES, *_NESTED_BRIDGES)
        return [only_retained(f"{self._prefix}{one}") for one in filters]

    def concerns(self, topic: str) -> bool:
        """Return whether `among` needs this topic."""
        if not topic.startswith(self._prefix):
            return False
        return topic.endswith("/bridge/state") or self._stray(topic) is not None

    def among(self, retained: Mapping[str, bytes]) -> list[str]:
        """Return the topics to clear."""
        return [t for t, payload in retained.items() if self._is_one(t, payload, retained)]

    def _is_one(self, topic: str, payload: bytes, retained: Mapping[str, bytes]) -> bool:
        looks_like_ours = self._stray(topic)
        if looks_like_ours is None or not looks_like_ours(payload):
            return False
        return not self._is_anothers(topic, retained)

    def _is_anothers(self, topic: str, retained: Mapping[str, bytes]) -> bool:
        """Return whether a topic belongs to a bridge whose base topic is below ours."""
        levels = topic.removeprefix(self._prefix).split("/")
        bases = ("/".join(levels[: n + 1]) for n in range(len(levels)))
        return any(f"{self._prefix}{base}/bridge/state" in retained for base in bases)

    def _stray(self, topic: str) -> Callable[[bytes], bool] | None:
        """Return the test of the payload, for a topic of our form that is not configured."""
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
            case ["bridge", "rule", rule, _]:
                return rule in self._rules
            case [station_id, "di", channel, "count"]:
                return (station_id, channel) in self._counted
            case [station_id, "di" | "do" | "cover" as kind, name, *_] if (
                station_id in self._channels
            ):
                return name in self._channels[station_id][kind]
        return levels[0] in self._channels


def only_retained(topic_filter: str) -> Subscription:
    """Return a subscription for retained messages; the retain flag marks them."""
    # QoS 0: brokers limit their queues for other levels, which our commands use.
    return Subscription(topic_filter, qos=0, live_only=False, as_published=False)


def _fits(shape: Sequence[str], levels: Sequence[str]) -> bool:
    """Return whether a topic has this shape, with a name in place of each `+`.

    The first name is an id, the second a channel or the id of a cover.
    """
    if len(shape) != len(levels):
        return False
    pairs = list(zip(shape, levels, strict=True))
    names = [level for want, level in pairs if want == "+"]
    if any(want not in {"+", level} for want, level in pairs):
        return False
    is_name = is_id if "cover" in shape else _CHANNEL.fullmatch
    return is_id(names[0]) and names[0] != "bridge" and all(map(is_name, names[1:]))
