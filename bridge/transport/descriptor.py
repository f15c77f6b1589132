"""Bytes through a non-blocking file descriptor, with a deadline on every call."""

import os
import select
from collections.abc import Callable

from bridge.clock import boot_s
from bridge.errors import PortError

_CHUNK = 4096
# A flood on a network socket must not hold `discard` for ever; a line gathers far less.
_DISCARD_LIMIT = 16 * _CHUNK


class DescriptorPort:
    """A Port over a descriptor that another function opened. One thread owns it.

    The descriptor must be non-blocking. `release` gives it back and must not raise; `gone` is
    what to tell the owner of the house when the other side has hung up.
    """

    def __init__(
        self, name: str, descriptor: int, release: Callable[[], None], *, gone: str
    ) -> None:
        self._name = name
        self._descriptor = descriptor
        self._release = release
        self._gone = gone
        self._held = b""  # taken from the descriptor, and not read yet
        self._input = _poller(descriptor, select.POLLIN)
        self._output = _poller(descriptor, select.POLLOUT)

    @property
    def name(self) -> str:
        """Return the port as the configuration writes it."""
        return self._name

    def read(self, count: int, deadline: float) -> bytes:
        """Return exactly `count` bytes, or fewer when the deadline comes first."""
        # All that is there is taken at once: what is not wanted yet will be, without a system call.
        while len(self._held) < count and self._ready(self._input, deadline):
            self._held += self._take(_CHUNK)
        data, self._held = self._held[:count], self._held[count:]
        return data

    def write(self, data: bytes, deadline: float) -> None:
        """Hand all of `data` to the line, or raise PortError at the deadline."""
        data = data[self._give(data) :]  # as a rule there is room
        while data:
            if not self._ready(self._output, deadline):
                raise PortError(f"{self._name} takes no bytes: {len(data)} could not be sent")
            data = data[self._give(data) :]

    def discard(self) -> bytes:
        """Take what waits in the input without waiting, and return it as evidence."""
        taken, self._held = self._held, b""
        while len(taken) < _DISCARD_LIMIT and self._ready(self._input, deadline=0.0):
            taken += self._take(_CHUNK)
        return taken

    def close(self) -> None:
        """Give the descriptor back. May be called twice."""
        if self._descriptor >= 0:
            # The number may soon belong to another line's port: never write to that one.
            self._descriptor = -1
            self._release()

    def _ready(self, poller: select.poll, deadline: float) -> bool:
        """Wait until the descriptor can go on; a deadline in the past is one look."""
        events = poller.poll(max(0.0, deadline - boot_s()) * 1000)
        if not events:
            return False
        # Bytes that arrived before a hang-up are read first; reading then tells of the hang-up.
        if events[0][1] & (select.POLLIN | select.POLLOUT):
            return True
        raise PortError(f"{self._name}: {self._gone}")

    def _take(self, count: int) -> bytes:
        try:
            data = os.read(self._descriptor, count)
        except BlockingIOError:
            return b""  # readiness was only a hint
        except OSError as error:
            raise PortError(f"{self._name}: {self._gone} ({error.strerror})") from error
        if not data:  # ready, and yet nothing to read: the end
            raise PortError(f"{self._name}: {self._gone}")
        return data

    def _give(self, data: bytes) -> int:
        try:
            return os.write(self._descriptor, data)
        except BlockingIOError:
            return 0  # readiness was only a hint
        except OSError as error:
            raise PortError(f"{self._name}: {self._gone} ({error.strerror})") from error


def _poller(descriptor: int, events: int) -> select.poll:
    poller = select.poll()
    poller.register(descriptor, events)
    return poller
