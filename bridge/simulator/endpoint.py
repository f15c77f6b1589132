"""Where a simulated line can be reached: what its thread needs of a pty or a TCP port."""

import os
import select
from typing import Protocol

# The far side reads, or its buffer runs over as that of a real adapter does.
WRITE_PATIENCE_S = 0.1
READ_AT_MOST = 4096


class Endpoint(Protocol):
    """One owner at a time: who starts the line, then the line's thread."""

    @property
    def port(self) -> str:
        """Return the port as a configuration writes it; known and unchanging once opened."""
        ...

    def open(self) -> None:
        """Appears. Raises OSError where that cannot be."""
        ...

    def filenos(self) -> list[int]:
        """Return the descriptors to wait on; empty while closed."""
        ...

    def read(self, fileno: int) -> bytes:
        """Return what came in on a descriptor that is ready; may be nothing."""
        ...

    def write(self, data: bytes) -> None:
        """Hand bytes to the master; what it does not take is lost."""
        ...

    def baud(self) -> int | None:
        """Return the speed that the master set, or None where that cannot be known."""
        ...

    def hang_up(self) -> None:
        """Disappears, and may be opened again under the same name."""
        ...

    def close(self) -> None:
        """Disappear for good. May be called twice."""
        ...


def write_patiently(fileno: int, data: bytes) -> None:
    """Write to a non-blocking descriptor; give up when the bytes are not taken for a while."""
    while data:
        try:
            data = data[os.write(fileno, data) :]
        except BlockingIOError:
            _, writable, _ = select.select([], [fileno], [], WRITE_PATIENCE_S)
            if not writable:
                return
