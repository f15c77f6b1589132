"""The interface of an endpoint: a pty or a TCP port through which a simulated line is reached."""

import os
import select
from typing import Protocol

# The master reads, or its buffer overflows as that of a real adapter does.
WRITE_PATIENCE_S = 0.1
READ_AT_MOST = 4096


class Endpoint(Protocol):
    """One owner at a time: the thread that starts the line, then the thread of the line."""

    @property
    def port(self) -> str:
        """Return the port as a configuration writes it; it does not change once opened."""

    def open(self) -> None:
        """Open the endpoint. Raises OSError if that is not possible."""

    def filenos(self) -> list[int]:
        """Return the descriptors to wait on; empty while closed."""

    def read(self, fileno: int) -> bytes:
        """Return the bytes that came in on a ready descriptor; may be empty."""

    def write(self, data: bytes) -> None:
        """Hand bytes to the master; bytes that it does not take are lost."""

    def baud(self) -> int | None:
        """Return the baud rate that the master set; None if it cannot be known."""

    def hang_up(self) -> None:
        """Close the port; it may be opened again under the same name."""

    def close(self) -> None:
        """Close the endpoint for good. May be called twice."""


def write_patiently(fileno: int, data: bytes) -> None:
    """Write to a non-blocking descriptor; give up if the bytes are not taken for a while."""
    while data:
        try:
            data = data[os.write(fileno, data) :]
        except BlockingIOError:
            _, writable, _ = select.select([], [fileno], [], WRITE_PATIENCE_S)
            if not writable:
                return
