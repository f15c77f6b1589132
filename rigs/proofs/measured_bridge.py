"""The bridge, which writes down how long its main and its MQTT thread were ever held up.

The first argument is the file for that, in seconds; the others are the bridge's.
"""

import sys
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

from bridge.cli.main import main
from bridge.mqtt.connection import Connection
from bridge.mqtt.session import Session

_ROUND_S = 0.1  # the main thread waits so long where there is nothing to do


class StallWatch:
    """Keeps the longest stall, in a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._longest_s = 0.0

    def saw(self, stall_s: float) -> None:
        """Takes one."""
        if stall_s > self._longest_s:
            self._longest_s = stall_s
            self._path.write_text(f"{stall_s:.3f}")


def measured(watch: StallWatch) -> int:
    """Runs the bridge under the watch."""
    wait, tick = Connection._wait, Session.tick
    woke = time.monotonic()
    ticked: float | None = None

    def timed_wait(self: Connection, *arguments: Any) -> tuple[bool, bool]:
        nonlocal woke
        watch.saw(time.monotonic() - woke)
        found = wait(self, *arguments)
        woke = time.monotonic()
        return found

    def timed_tick(self: Session, now: float) -> None:
        nonlocal ticked
        if ticked is not None:
            watch.saw(time.monotonic() - ticked - _ROUND_S)
        tick(self, now)
        ticked = time.monotonic()

    def opened(self: Connection) -> None:
        nonlocal woke
        connect(self)
        woke = time.monotonic()

    connect = Connection.open
    with (
        patch.object(Connection, "_wait", timed_wait),
        patch.object(Connection, "open", opened),
        patch.object(Session, "tick", timed_tick),
    ):
        return main(sys.argv[2:])


if __name__ == "__main__":
    sys.exit(measured(StallWatch(Path(sys.argv[1]))))
