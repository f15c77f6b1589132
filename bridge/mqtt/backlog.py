"""The event queue of the main thread, which knows its size."""

import queue
import threading
from typing import TypeVar

from bridge.mqtt.events import Received

T = TypeVar("T")

_UNIT_BYTES = 256  # of a message count as one event: 16,384 events are at most 4 MiB


class EventQueue(queue.SimpleQueue[T]):
    """A queue of events that counts large messages several times. One thread takes them out.

    A `queue.SimpleQueue`, because a signal may come while a command waits for an event: it could
    break into a `queue.Queue` between two statements, and leave its lock in a wrong state.
    """

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.Lock()
        self._put_units = 0
        self._taken_units = 0

    def backlog(self) -> int:
        """Return the number of waiting events; a message of n bytes counts as 1 + n / 256."""
        return self._put_units - self._taken_units

    def put(self, item: T, block: bool = True, timeout: float | None = None) -> None:
        """See `queue.SimpleQueue`."""
        with self._lock:
            self._put_units += _units(item)
        super().put(item, block, timeout)

    def get(self, block: bool = True, timeout: float | None = None) -> T:
        """See `queue.SimpleQueue`."""
        item = super().get(block, timeout)
        self._taken_units += _units(item)
        return item

    def get_nowait(self) -> T:
        """See `queue.SimpleQueue`."""
        return self.get(block=False)


def _units(event: object) -> int:
    return 1 + event.size_bytes // _UNIT_BYTES if isinstance(event, Received) else 1
