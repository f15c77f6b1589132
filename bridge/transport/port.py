"""The interface of a port, which the bus uses."""

from typing import Protocol


class Port(Protocol):
    """Bytes in and out, with a deadline for every call. One thread owns it.

    Deadlines are instants of `bridge.clock.boot_s`. Every method raises PortError when the port is
    gone; after that only `close` may be called.
    """

    @property
    def name(self) -> str:
        """Return the port as the configuration writes it, for messages."""

    def read(self, count: int, deadline: float) -> bytes:
        """Return exactly `count` bytes, or fewer at the deadline."""

    def write(self, data: bytes, deadline: float) -> None:
        """Write all of `data`, or raise PortError at the deadline."""

    def discard(self) -> bytes:
        """Drop the waiting input without waiting for more; return it as evidence."""

    def close(self) -> None:
        """Close the port. Never raises; may be called twice."""
