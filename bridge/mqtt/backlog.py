"""The event queue of the main thread, which knows its size."""

import queue
from typing import TypeVar

from bridge.mqtt.events import Received

T = TypeVar("T")

_UNIT_BYTES = 256  # of a message count as one event: 16,384 events are at most 4 MiB


class EventQueue(queue.Queue[T]):
    """A queue of events that counts large messages several times."""

    def __init__(self) -> None:
        super().__init__()
        self._units = 0

    def backlog(self) -> int:
        """Return the number of waiting events; a message of n bytes counts as 1 + n / 256."""
        return self._units

    # The methods that a subclass of `queue.Queue` may replace; both are called with its lock held.

    def _put(self, item: T) -> None:
        super()._put(item)
        self._units += _units(item)

    def _get(self) -> T:
        item: T = super()._get()
        self._units -= _units(item)
        return item


def _units(event: object) -> int:
    return 1 + event.size_bytes // _UNIT_BYTES if isinstance(event, Received) else 1
