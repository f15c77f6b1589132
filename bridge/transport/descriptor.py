"""A port over a non-blocking file descriptor, with a deadline for every call."""

import os
import select
from collections.abc import Callable

from bridge.clock import boot_s
from bridge.errors import PortError

_CHUNK = 4096
# A flood on a network socket must not keep `discard` busy; a serial line collects far less.
_DISCARD_LIMIT = 16 * _CHUNK


class DescriptorPort:
    """A Port over an open descriptor. One thread owns it.

    The descriptor must be non-blocking. `release` closes it and must not raise. `gone` is the
    message for the user when the other side has hung up.
    """

    def __init__(
        self, name: str, descriptor: int, release: Callable[[], None], *, gone: str
    ) -> None:
        self._name = name
        self._descriptor = descriptor
        self._release = release
        self._gone = gone
        self._held = b""  # already taken from the descriptor, not yet read
        self._input = _poller(descriptor, select.POLLIN)
        self._output = _poller(descriptor, select.POLLOUT)

    @property
    def name(self) -> str:
        """Return the port as the configuration writes it."""
        return self._name

    def read(self, count: int, deadline: float) -> bytes:
        """Return exactly `count` bytes, or fewer at the deadline."""
        # Take everything that is there: the next read then needs no system call.
        while len(self._held) < count and self._ready(self._input, deadline):
            self._held += self._take(_CHUNK)
        data, self._held = self._held[:count], self._held[count:]
        return data

    def write(self, data: bytes, deadline: float) -> None:
        """Write all of `data`, or raise PortError at the deadline."""
        data = data[self._give(data) :]  # as a rule there is room
        while data:
            if not self._ready(self._output, deadline):
                raise PortError(f"{self._name} takes no bytes: {len(data)} could not be sent")
            data = data[self._give(data) :]

    def discard(self) -> bytes:
        """Drop the waiting input without waiting for more; return it as evidence."""
        taken, self._held = self._held, b""
        while len(taken) < _DISCARD_LIMIT and self._ready(self._input, deadline=0.0):
            taken += self._take(_CHUNK)
        return taken

    def close(self) -> None:
        """Close the descriptor. May be called twice."""
        if self._descriptor >= 0:
            # The number may soon belong to the port of another line: never write to it.
            self._descriptor = -1
            self._release()

    def _ready(self, poller: select.poll, deadline: float) -> bool:
        """Wait until the descriptor is ready; a deadline in the past means one look."""
        events = poller.poll(max(0.0, deadline - boot_s()) * 1000)
        if not events:
            return False
        # Bytes from before a hang-up are read first; a later read reports the hang-up.
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
