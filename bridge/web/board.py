"""What the panel shows: the newest of everything, and what happened lately.

Each entry has a number. A browser remembers the last number that it got and asks for what is newer:
a slow one misses values between, and needs no queue.
"""

import json
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

SCAN_KEY = "scan"  # of the state of a search for modules
BACKUP_KEY = "backup"
# How many are kept of what happened, and of what passed on a line.
MOST_KEPT = {"happened": 500, "trace": 300}


@dataclass(frozen=True)
class BoardEntry:
    """One document; `key` names what it is about, or the list that it is in."""

    serial: int
    key: str
    document: Mapping[str, Any]

    @cached_property
    def text(self) -> str:
        """Return it as JSON: made once, however many browsers there are."""
        return json.dumps(self.document, ensure_ascii=False, separators=(",", ":"))


@dataclass(frozen=True, slots=True)
class News:
    """Everything that is newer than a number."""

    serial: int
    state: list[BoardEntry] = field(default_factory=list)
    noted: list[BoardEntry] = field(default_factory=list)


class Board:
    """The main thread writes, the thread of the panel reads.

    Attributes:
        progress: The last sign of life of the main thread (`bridge.clock.boot_s`).
    """

    def __init__(self) -> None:
        self.progress = 0.0
        self._lock = threading.Lock()  # held for moments
        self._serial = 0
        self._state: dict[str, BoardEntry] = {}
        self._noted = {name: deque[BoardEntry](maxlen=most) for name, most in MOST_KEPT.items()}
        self._wake: Callable[[], None] = _no_reader
        self._is_woken = False

    def call(self, wake: Callable[[], None]) -> None:
        """Call `wake` when something is new, once until `since` was asked."""
        self._wake = wake

    def put(self, key: str, document: Mapping[str, Any]) -> None:
        """Take the newest of `key`; the same as before is nothing new."""
        with self._lock:
            before = self._state.get(key)
            if before is not None and before.document == document:
                return
            self._serial += 1
            # At the end: the order of the dictionary is that of the numbers.
            self._state.pop(key, None)
            self._state[key] = BoardEntry(self._serial, key, document)
        self._call()

    def keep(self, keys: Collection[str]) -> None:
        """Forget all that is none of `keys`."""
        with self._lock:
            self._state = {key: entry for key, entry in self._state.items() if key in keys}

    def note(self, name: str, document: Mapping[str, Any]) -> None:
        """Add to a list of `MOST_KEPT`; the oldest is forgotten."""
        with self._lock:
            self._serial += 1
            self._noted[name].append(BoardEntry(self._serial, name, document))
        self._call()

    def since(self, serial: int) -> News:
        """Return what is newer than `serial`, each list with the oldest first."""
        with self._lock:
            self._is_woken = False
            return News(
                self._serial,
                _newer(reversed(self._state.values()), serial),
                [one for noted in self._noted.values() for one in _newer(reversed(noted), serial)],
            )

    def _call(self) -> None:
        if not self._is_woken:
            self._is_woken = True
            self._wake()


def _newer(newest_first: Iterable[BoardEntry], serial: int) -> list[BoardEntry]:
    found = []
    for entry in newest_first:
        if entry.serial <= serial:
            break
        found.append(entry)
    found.reverse()
    return found


def _no_reader() -> None:
    pass
