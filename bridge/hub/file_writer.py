"""Writes a file in a thread of its own, so that a defective card delays no line."""

import logging
import threading
from collections.abc import Callable
from pathlib import Path

from bridge.bounded_log import BoundedLog, Cause


class FileWriter:
    """One file of the bridge. Only the main thread uses it.

    A write can take minutes or never end. So each has its own short thread, one at a time, which
    gets frozen values.
    """

    def __init__(self, what: str, bounded: BoundedLog) -> None:
        """Args: `what` is in the file, for the log; `bounded` is the log."""
        self._what = what
        self._bounded = bounded
        self._writing: threading.Thread | None = None

    @property
    def is_busy(self) -> bool:
        """Return whether a write is in progress."""
        return self._writing is not None and self._writing.is_alive()

    def start(self, path: Path, write: Callable[[], None], written: Callable[[], None]) -> None:
        """Begin a write; `written` is called, in its thread, when it worked."""
        self._writing = threading.Thread(
            target=self._work,
            args=(path, write, written),
            name=f"{self._what} to disk",
            daemon=True,
        )
        self._writing.start()

    def wait(self, timeout_s: float) -> None:
        """Wait for the write in progress, if any."""
        if self._writing is not None:
            self._writing.join(timeout_s)

    def close(self, path: Path, timeout_s: float, write_rest: Callable[[], None]) -> None:
        """Have the rest written at the end of the process; log it if the disk hangs."""
        self.wait(timeout_s)  # for a write that began before the last changes
        if not self.is_busy:
            write_rest()
            self.wait(timeout_s)
        if self.is_busy:
            text = f"the {self._what} are not in {path}: the disk hangs"
            self._bounded.tell(Cause.DISK, f"{self._what} hang", logging.ERROR, text)

    def _work(self, path: Path, write: Callable[[], None], written: Callable[[], None]) -> None:
        try:
            write()
        except OSError as error:
            text = f"the {self._what} cannot be written to {path}: {error}"
            self._bounded.tell(Cause.DISK, self._what, logging.WARNING, text, once=True)
            return
        self._bounded.end(Cause.DISK, self._what, f"the {self._what} are written to {path} again")
        written()
