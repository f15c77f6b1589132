"""A Home Assistant that knows a house, and what has to hold between the two."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from home_assistant.figures import note, note_slowest
from home_assistant.house import House, announced, house
from home_assistant.instance import HomeAssistant
from home_assistant.releases import NEW, OLD, Release
from support.mosquitto import Mosquitto

# Device discovery came with 2024.11: the old release knows the other form alone.
WAYS = [
    pytest.param((OLD, "single"), id=f"{OLD.version}-single"),
    pytest.param((NEW, "device"), id=f"{NEW.version}-device"),
    pytest.param((NEW, "single"), id=f"{NEW.version}-single"),
]
_PATIENCE_S = 120.0
_LOOK_AGAIN_S = 0.1  # the registries tell of changes in too many ways to follow them all


@dataclass(frozen=True, slots=True)
class Home:
    """Both of them."""

    assistant: HomeAssistant
    house: House
    discovery: str

    def note(self, what: str) -> None:
        """Keeps a figure."""
        note(f"{self.assistant.release.version} {self.discovery}", what)

    def note_slowest(self, what: str, took_s: float) -> None:
        """Keeps the largest of several figures of one kind."""
        note_slowest(f"{self.assistant.release.version} {self.discovery}", what, took_s)

    @property
    def announced(self) -> dict[str, dict[str, Any]]:
        """The entities that are announced just now, by unique id."""
        found = announced(self.house.announcements())
        return {name: one for name, one in found.items() if "unique_id" in one}

    def ids(self) -> dict[str, str]:
        """The entity id of every entity, by its unique id."""
        known = self.assistant.live.entities()
        return {unique_id: entry["entity_id"] for unique_id, entry in known.items()}

    def wait_until_complete(self) -> float:
        """Wait until exactly the announced entities are present and available.

        Returns:
            The seconds that it took.
        """
        began = time.monotonic()
        while True:
            wrong = self._differences()
            took_s = time.monotonic() - began
            if not wrong:
                return took_s
            assert took_s < _PATIENCE_S, f"after {took_s:.0f} s: {wrong[:20]}"
            time.sleep(_LOOK_AGAIN_S)

    def _differences(self) -> list[str]:
        wanted = self.announced
        known = self.assistant.live.entities()
        found = [f"{name} is missing" for name in sorted(wanted.keys() - known.keys())]
        found += [f"{name} is a ghost" for name in sorted(known.keys() - wanted.keys())]
        states = self.assistant.live.states
        for entry in known.values():
            change = states.get(entry["entity_id"])
            if entry["disabled_by"] is None and (change is None or change.state == "unavailable"):
                found.append(f"{entry['entity_id']} is not available")
        return found


@contextmanager
def started_broker(directory: Path, *, persistence: bool = False) -> Iterator[Mosquitto]:
    """A mosquitto of our own, as long as the block lasts."""
    mosquitto = Mosquitto(directory, persistence=persistence)
    mosquitto.start()
    try:
        yield mosquitto
    finally:
        mosquitto.stop()


@contextmanager
def home(
    directory: Path,
    broker: Mosquitto,
    release: Release,
    lines: str,
    discovery: str,
    *,
    former: bool = False,
) -> Iterator[Home]:
    """Starts both; the bridge is there first, and Home Assistant has found it all at the end."""
    with (
        house(directory, broker, lines, discovery, former=former) as shown,
        HomeAssistant(release) as assistant,
    ):
        assistant.add_broker(broker.port)
        built = Home(assistant, shown, discovery)
        took_s = built.wait_until_complete()
        built.note(f"all {len(built.announced)} entities there {took_s:.1f} s after set-up")
        yield built


def timed(action: Callable[[], object]) -> float:
    """Return how long something took, in seconds."""
    began = time.monotonic()
    action()
    return time.monotonic() - began
