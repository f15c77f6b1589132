"""A port that reports the bytes that pass through it while a trace runs."""

from collections.abc import Callable

from bridge.transport.port import Port

# Instant (`bridge.clock.boot_s`), bytes, and whether they were sent to the modules.
Hear = Callable[[float, bytes, bool], None]


class TappedPort:
    """A Port that calls `hear` for each chunk, in the thread of its owner.

    `echoes` says whether the adapter echoes our own bytes: these are reported once.
    """

    def __init__(
        self, port: Port, hear: Hear, echoes: Callable[[], bool], clock: Callable[[], float]
    ) -> None:
        self._port = port
        self._hear = hear
        self._echoes = echoes
        self._clock = clock
        self._echo_due = b""

    @property
    def name(self) -> str:
        """See `Port`."""
        return self._port.name

    def read(self, count: int, deadline: float) -> bytes:
        """See `Port`."""
        data = self._port.read(count, deadline)
        self._tell_read(data)
        return data

    def write(self, data: bytes, deadline: float) -> None:
        """See `Port`."""
        self._port.write(data, deadline)
        self._hear(self._clock(), data, True)
        self._echo_due = data if self._echoes() else b""

    def discard(self) -> bytes:
        """See `Port`."""
        data = self._port.discard()
        self._tell_read(data)
        return data

    def close(self) -> None:
        """See `Port`."""
        self._port.close()

    def _tell_read(self, data: bytes) -> None:
        if not data:
            return
        due, self._echo_due = self._echo_due, b""
        if due.startswith(data):
            self._echo_due = due[len(data) :]
        else:
            self._hear(self._clock(), data, False)
