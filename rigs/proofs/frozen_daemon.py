"""The daemon's command line with one thread that stops for ever at SIGUSR1.

The first argument is the thread (line, mqtt or main), the second the seconds after which the
bridge takes a thread for stuck, or `-` for its own limit; the others are the bridge's.
"""

import signal
import sys
import threading
import time
from typing import Any

from bridge.cli.main import main
from bridge.daemon import app
from bridge.mqtt.connection import Connection
from bridge.mqtt.session import Session
from bridge.transport.bus import Bus

# What each thread comes to again and again.
PLACES: dict[str, tuple[type, str]] = {
    "line": (Bus, "exchange"),
    "mqtt": (Connection, "step"),
    "main": (Session, "tick"),
}


def freeze_on_signal(owner: type, name: str) -> None:
    """From SIGUSR1 on, this method never returns."""
    frozen = threading.Event()
    method = getattr(owner, name)

    def freezing(*arguments: Any, **options: Any) -> Any:
        while frozen.is_set():
            time.sleep(3600)
        return method(*arguments, **options)

    setattr(owner, name, freezing)
    signal.signal(signal.SIGUSR1, lambda *_: frozen.set())


if __name__ == "__main__":
    freeze_on_signal(*PLACES[sys.argv[1]])
    if sys.argv[2] != "-":
        assert app._STUCK_AFTER_S > 0  # it is still called so
        app._STUCK_AFTER_S = float(sys.argv[2])
    sys.exit(main(sys.argv[3:]))
