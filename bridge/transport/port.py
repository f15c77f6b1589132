"""What the bus needs of a port, whatever carries the bytes."""

from typing import Protocol


class Port(Protocol):
    """Bytes in and out with a deadline on every call. One thread owns it.

    Deadlines are instants of `bridge.clock.boot_s`, in seconds. Every method raises PortError when
    the port is gone; after that only `close` may be called.
    """

    @property
    def name(self) -> str:
        """The port as the configuration writes it, for messages."""
        ...

    def read(self, count: int, deadline: float) -> bytes:
        """Returns exactly `count` bytes, or fewer when the deadline comes first."""
        ...

    def write(self, data: bytes, deadline: float) -> None:
        """Hands all of `data` to the line, or raises PortError at the deadline."""
        ...

    def discard(self) -> bytes:
        """Takes what waits in the input without waiting, and returns it as evidence."""
        ...

    def close(self) -> None:
        """Gives the port back. Never raises; may be called twice."""
        ...
