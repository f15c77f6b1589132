"""Decides when counts are written to the disk: seldom, and in a thread that delays no line."""

import logging
import os
import time
from pathlib import Path

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.config.current import CurrentConfig
from bridge.hub.count_file import read_counts, write_counts
from bridge.hub.counts import Counts
from bridge.hub.file_writer import FileWriter

_log = logging.getLogger(__name__)

# docs/failures.md E3: cards wear out. A power cut loses the counts since the last write.
EVERY_S = 900.0


class CountKeeper:
    """Reads the file at the start, and writes changes. Only the main thread uses it.

    Without a counted input nothing is ever written.
    """

    def __init__(
        self, current: CurrentConfig, counts: Counts, *, budgets: Budgets | None = None
    ) -> None:
        """Create it; `budgets` limit its log lines."""
        self._bounded = BoundedLog(_log, time.monotonic, budgets)
        self._counts = counts
        self._current = current
        self._due_at = 0.0
        self._kept = (self._path, 0)  # which file has how many of the changes
        self._writer = FileWriter("counts", self._bounded)

    def open(self, now: float) -> None:
        """Load the counts of an earlier run. A file that cannot be read is reported and ignored."""
        self._due_at = now + EVERY_S
        try:
            self._counts.restore(read_counts(self._path))
        except FileNotFoundError:
            self._tell_missing()
        except OSError as error:
            self._warn(f"the counts in {self._path} cannot be read ({error}): {_WITHOUT}")
        except ValueError as error:
            self._warn(f"the counts in {self._path} are damaged ({error}): {_WITHOUT}")

    def _tell_missing(self) -> None:
        if not self._counts.any:
            return
        if _can_be_made(self._path):
            text = f"no counts are kept in {self._path} yet: {_WITHOUT}"
            self._bounded.tell(Cause.DISK, "start", logging.INFO, text)
        else:  # report it now, and not at the first write
            self._warn(f"no counts can be kept in {self._path}: we may not write there")

    def _warn(self, text: str) -> None:
        self._bounded.tell(Cause.DISK, "start", logging.WARNING, text)

    def tick(self, now: float) -> None:
        """Start a write if a count changed and the last write is long ago."""
        if now >= self._due_at and self._lacks and not self._writer.is_busy:
            self._due_at = now + EVERY_S
            self._write()

    def wait(self, timeout_s: float) -> None:
        """Wait for the write in progress, if any."""
        self._writer.wait(timeout_s)

    def close(self, timeout_s: float) -> None:
        """Write the remaining changes at the end of the process; wait for it."""
        self._writer.close(self._path, timeout_s, self._write)

    @property
    def _path(self) -> Path:
        return self._current.config.state_file("counts")

    @property
    def _lacks(self) -> bool:
        return self._counts.any and (self._path, self._counts.changes) != self._kept

    def _write(self) -> None:
        if not self._lacks:
            return
        path, counts, changes = self._path, self._counts.kept(), self._counts.changes

        def written() -> None:
            self._kept = (path, changes)

        self._writer.start(path, lambda: write_counts(path, counts), written)


_WITHOUT = "counting goes on from what the broker retains, else from 0"


def _can_be_made(path: Path) -> bool:
    """Return whether the file and its missing folders can be created."""
    there = next(folder for folder in path.parents if folder.exists())
    return os.access(there, os.W_OK | os.X_OK)
