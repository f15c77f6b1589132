"""SIGTERM and SIGINT for commands that run until they are stopped."""

import signal
from types import FrameType

from bridge.daemon.app import Wanted


class StopSignals:
    """Remembers a signal. Handlers only set a flag; the main thread reads it."""

    def __init__(self) -> None:
        self._stop = False

    def install(self) -> None:
        """Handle SIGTERM and SIGINT."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_stop)

    def poll(self) -> Wanted | None:
        """Return the outcome that a signal asked for, or None."""
        return Wanted.STOP if self._stop else None

    def _on_stop(self, _number: int, _frame: FrameType | None) -> None:
        self._stop = True
