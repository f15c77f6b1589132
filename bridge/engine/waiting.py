"""The commands that wait for a line: put in by the main thread, taken out by the line's own."""

import queue
from collections import deque
from collections.abc import Callable

from bridge.model import Command


class _Stop:
    """Wakes a worker that waits for commands."""


class WaitingCommands:
    """A queue whose end may be overtaken. Only `put` and `stop` are for other threads.

    `is_absolute_latch` tells whether a command merely sets latch outputs to given values:
    each pulse and each toggle means something of its own, so they neither overtake nor are
    overtaken. `overtaken` is given each command that need not be sent any more.
    """

    def __init__(
        self,
        is_absolute_latch: Callable[[Command], bool],
        overtaken: Callable[[Command], None],
    ) -> None:
        self.stopping = False
        self._inbox: queue.Queue[Command | _Stop] = queue.Queue()
        self._waiting: deque[Command] = deque()
        self._is_absolute_latch = is_absolute_latch
        self._overtaken = overtaken

    def put(self, command: Command) -> None:
        """Adds a command; wakes the worker."""
        self._inbox.put(command)

    def stop(self) -> None:
        """Asks the worker to end; wakes it."""
        self._inbox.put(_Stop())

    def __len__(self) -> int:
        return len(self._waiting)

    def pop(self) -> Command:
        """The oldest command."""
        return self._waiting.popleft()

    def collect(self, wait_s: float = 0.0) -> None:
        """Moves in what was put; waits up to `wait_s` seconds for the first."""
        try:
            item = self._inbox.get(timeout=wait_s) if wait_s > 0 else self._inbox.get_nowait()
            while True:
                if isinstance(item, _Stop):
                    self.stopping = True
                else:
                    self._overtake(item)
                    self._waiting.append(item)
                item = self._inbox.get_nowait()
        except queue.Empty:
            return

    def newer_than(self, command: Command) -> bool:
        """Whether a command that came later names an output of `command`."""
        self.collect()
        return any(c.station == command.station and c.mask & command.mask for c in self._waiting)

    def _overtake(self, newer: Command) -> None:
        if not self._is_absolute_latch(newer):
            return
        for older in [c for c in self._waiting if self._is_covered(c, newer)]:
            self._waiting.remove(older)
            self._overtaken(older)

    def _is_covered(self, older: Command, newer: Command) -> bool:
        same = older.station == newer.station and not older.mask & ~newer.mask
        return same and self._is_absolute_latch(older)
