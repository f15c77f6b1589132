"""What the bus needs of a port, whatever carries the bytes."""

from typing import Protocol


class Port(Protocol):
    """Bytes in and out with a deadline on every call. One thread owns it.

    Deadlines are instants of `bridge.clock.boot_s`, in seconds. Every method raises PortError when
    the port is gone; after that only `close` may be called.
    """

    @property
    def name(self) -> str:
        """Return the port as the configuration writes it, for messages."""
        ...

    def read(self, count: int, deadline: float) -> bytes:
        """Return exactly `count` bytes, or fewer when the deadline comes first."""
        ...

    def write(self, data: bytes, deadline: float) -> None:
        """Hand all of `data` to the line, or raise PortError at the deadline."""
        ...

    def discard(self) -> bytes:
        """Take what waits in the input without waiting, and return it as evidence."""
        ...

    def close(self) -> None:
        """Give the port back. Never raises; may be called twice."""
        ...
