"""What a bridge has told of its modules through the broker, as a panel shows it."""

from collections.abc import Mapping
from typing import Any

from bridge.cli.desk.panel_view import Look
from bridge.model import MODULE_TYPES, ModuleType, bit
from bridge.mqtt.events import Received
from bridge.mqtt.strict_json import object_of
from bridge.mqtt.topics import Topics


class House:
    """Takes what arrives at the broker. Its models come from what the bridge says of itself.

    Attributes:
        models: By station id, in the order of the configuration, with the name of each.
    """

    def __init__(self, topics: Topics, station_ids: list[str]) -> None:
        self.models: dict[str, tuple[str, ModuleType]] = {}
        self._topics = topics
        self._wanted = station_ids
        self._values: dict[str, bytes] = {}
        self._lines: dict[str, str] = {}

    def receive(self, message: Received) -> None:
        """Note what a topic holds now."""
        if message.topic == self._topics.bridge_info:
            self._read_info(object_of(message.payload))
        self._values[message.topic] = message.payload

    def look(self, station_id: str) -> Look:
        """Return how a module looks now."""
        snapshot = object_of(self._values.get(self._topics.snapshot(station_id), b""))
        _, model = self.models[station_id]
        return Look(
            away=self._away(station_id),
            inputs=_bits(snapshot.get("di")),
            outputs=_bits(snapshot.get("do")),
            pulse=sum(
                bit(output)
                for output in range(1, model.outputs + 1)
                if self._values.get(self._topics.mode(station_id, output)) == b"pulse"
            ),
        )

    def _away(self, station_id: str) -> str:
        """Return which of bridge, line and station is not there (docs/contract.md)."""
        line = self._lines[station_id]
        for what, topic in (
            ("the bridge", self._topics.bridge_state),
            (f"line {line}", self._topics.line_availability(line)),
            ("the module", self._topics.availability(station_id)),
        ):
            if self._values.get(topic) != b"online":
                return f"{what} is offline: these states are old"
        return ""

    def _read_info(self, info: Mapping[str, Any]) -> None:
        self.models.clear()
        for line in info.get("lines", ()):
            for station in line["stations"]:
                model = MODULE_TYPES.get(station["model"])
                if model and (not self._wanted or station["id"] in self._wanted):
                    self.models[station["id"]] = (f"{station['id']} {station['name']}", model)
                    self._lines[station["id"]] = line["id"]


def _bits(values: object) -> int:
    channels = values.items() if isinstance(values, dict) else ()
    return sum(bit(int(channel)) for channel, word in channels if word == "ON")
