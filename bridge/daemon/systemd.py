"""Reports to systemd: READY, WATCHDOG, RELOADING and STOPPING (sd_notify(3))."""

import os
import socket
import time
from collections.abc import Mapping

_US_PER_S = 1_000_000
_NS_PER_US = 1_000


class Notifier:
    """Sends states to $NOTIFY_SOCKET; does nothing without one, and ignores failures.

    A missing socket must not end a working bridge. If the watchdog is not heard, systemd restarts
    the bridge anyway.
    """

    def __init__(self, environ: Mapping[str, str]) -> None:
        self._environ = environ

    @property
    def watchdog_interval_s(self) -> float | None:
        """Return how often `watchdog` is due: half of systemd's time; None: no watchdog."""
        pid = self._environ.get("WATCHDOG_PID", str(os.getpid()))
        usec = self._environ.get("WATCHDOG_USEC", "")
        if pid != str(os.getpid()) or not usec.isdecimal() or int(usec) == 0:
            return None
        return int(usec) / _US_PER_S / 2

    def ready(self, status: str) -> None:
        """Report that the start, or a reload, is complete."""
        self._send("READY=1", _status(status))

    def watchdog(self) -> None:
        """Report that all threads are healthy."""
        self._send("WATCHDOG=1")

    def reloading(self) -> None:
        """Report that the configuration is read again; `ready` ends this state."""
        # Type=notify-reload requires the time; older versions of systemd ignore it.
        now_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // _NS_PER_US
        self._send("RELOADING=1", f"MONOTONIC_USEC={now_us}")

    def stopping(self) -> None:
        """Report that the stop has begun."""
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        """Set the line that `systemctl status` shows."""
        self._send(_status(text))

    def _send(self, *assignments: str) -> None:
        address = self._environ.get("NOTIFY_SOCKET", "")
        if not address:
            return
        if address.startswith("@"):  # an abstract socket: its name starts with a NUL byte
            address = f"\0{address[1:]}"
        kind = socket.SOCK_DGRAM | socket.SOCK_NONBLOCK  # a full queue must not block the caller
        try:
            with socket.socket(socket.AF_UNIX, kind) as sender:
                sender.sendto("\n".join(assignments).encode(), address)
        except OSError:
            return


def _status(text: str) -> str:
    # A line break would start another assignment.
    return f"STATUS={' '.join(text.split())}"
