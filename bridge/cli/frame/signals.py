"""What SIGTERM and SIGINT ask of a command that runs until it is told to stop."""

import signal
from types import FrameType

from bridge.daemon.app import Wanted


class StopSignals:
    """Remembers that a signal came. Handlers only set a flag; the main thread looks at it."""

    def __init__(self) -> None:
        self._stop = False

    def install(self) -> None:
        """Take over SIGTERM and SIGINT."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_stop)

    def poll(self) -> Wanted | None:
        """Return what is to be done now, if anything."""
        return Wanted.STOP if self._stop else None

    def _on_stop(self, _number: int, _frame: FrameType | None) -> None:
        self._stop = True
