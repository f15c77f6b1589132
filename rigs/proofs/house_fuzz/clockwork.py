"""A virtual clock for a program with threads: only one thread runs at a time.

A thread that waits hands over to the one that is due next. So each run is the same, and an hour of
a house takes seconds.
"""

import heapq
import itertools
import math
import queue
import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

START_S = 1000.0


class Thread:
    """Stands in for `threading.Thread` on a clockwork."""

    def __init__(self, clockwork: "Clockwork", target: Callable[[], None], name: str) -> None:
        self.name = name
        self.ticket = 0  # of the entry on the agenda that counts: others are stale
        self.turn = threading.Lock()
        self.turn.acquire()
        self.ended = False
        self._begun = False
        self._clockwork = clockwork
        self._target = target

    def start(self) -> None:
        """Begin when it is its turn."""
        self._begun = True
        self._clockwork.threads.append(self)
        threading.Thread(target=self._run, name=self.name, daemon=True).start()
        self._clockwork.wake(self)

    def is_alive(self) -> bool:
        """Tell whether it runs."""
        return self._begun and not self.ended

    def join(self, timeout: float | None = None) -> None:
        """Wait for its end."""
        until = self._clockwork.awake_s + (math.inf if timeout is None else timeout)
        while self.is_alive() and self._clockwork.awake_s < until:
            self._clockwork.wait(0.01)

    def _run(self) -> None:
        self.turn.acquire()
        try:
            self._target()
        except BaseException as error:  # noqa: BLE001  # told where the run is judged
            self._clockwork.errors.append(f"{self.name}: {type(error).__name__}: {error}")
        self.ended = True
        self._clockwork.leave()


class Clockwork:
    """The clock, the agenda, and whose turn it is.

    Attributes:
        now: Seconds since boot, a suspend included.
        awake_s: The same without the time in which the machine was suspended.
        threads: All that were started.
        errors: What threads died of.
    """

    def __init__(self) -> None:
        self.now = START_S
        self.awake_s = START_S
        self.threads: list[Thread] = []
        self.errors: list[str] = []
        self._slept_s = 0.0
        self._agenda: list[tuple[float, int, Thread | Callable[[], None], int]] = []
        self._order = itertools.count()
        self._current = Thread(self, lambda: None, "test")

    def boot_s(self) -> float:
        """Stand in for `bridge.clock.boot_s`."""
        return self.now

    def monotonic(self) -> float:
        """Stand in for `time.monotonic`."""
        return self.awake_s

    def after(self, seconds: float, action: Callable[[], None]) -> None:
        """Have something done that does not wait."""
        heapq.heappush(self._agenda, (self.awake_s + seconds, next(self._order), action, 0))

    def suspend(self, seconds: float) -> None:
        """Let the machine sleep: the clock goes on, and nothing else."""
        self._slept_s += seconds
        self.now += seconds

    @property
    def current(self) -> Thread:
        """The thread whose turn it is."""
        return self._current

    def wake(self, thread: Thread) -> None:
        """Give a thread its turn as soon as the one that runs waits."""
        heapq.heappush(self._agenda, (self.awake_s, next(self._order), thread, thread.ticket))

    def wait(self, seconds: float) -> None:
        """Let time pass for the thread whose turn it is; `wake` ends it."""
        until = self.awake_s + max(seconds, 0.0)
        agenda = self._agenda
        if not agenda or agenda[0][0] > until:
            self._set(until)
            return
        me = self._current
        heapq.heappush(agenda, (until, next(self._order), me, me.ticket))
        following = self._following()
        if following is not me:
            following.turn.release()
            me.turn.acquire()

    def leave(self) -> None:
        """Hand on for good: the thread whose turn it is ends."""
        self._following().turn.release()

    def _following(self) -> Thread:
        """Do what is due up to the next turn of a thread, and return that thread."""
        agenda = self._agenda
        while True:
            instant, _, whom, ticket = heapq.heappop(agenda)
            if not isinstance(whom, Thread):
                self._set(instant)
                whom()
            elif ticket == whom.ticket:
                self._set(instant)
                whom.ticket += 1
                self._current = whom
                return whom

    def _set(self, awake_s: float) -> None:
        if awake_s > self.awake_s:
            self.awake_s = awake_s
            self.now = awake_s + self._slept_s


class Queue(Generic[T]):
    """Stands in for `queue.Queue` and `queue.SimpleQueue` with one reader."""

    def __init__(self, clockwork: Clockwork, maxsize: int = 0) -> None:
        self._clockwork = clockwork
        self._most = maxsize or math.inf
        self._items: deque[T] = deque()
        self._reader: Thread | None = None

    def put(self, item: T) -> None:
        """Add an item, and wake the reader."""
        self._items.append(item)
        reader, self._reader = self._reader, None
        if reader is not None:
            self._clockwork.wake(reader)

    def put_nowait(self, item: T) -> None:
        """Add an item if there is room."""
        if len(self._items) >= self._most:
            raise queue.Full
        self.put(item)

    def get(self, timeout: float = math.inf) -> T:
        """Take out an item, waiting for it."""
        if not self._items and timeout > 0:
            self._reader = self._clockwork.current
            self._clockwork.wait(timeout)
            self._reader = None
        return self.get_nowait()

    def get_nowait(self) -> T:
        """Take out an item if there is one."""
        if not self._items:
            raise queue.Empty
        return self._items.popleft()

    def empty(self) -> bool:
        """Tell whether there is nothing in it."""
        return not self._items

    def qsize(self) -> int:
        """Return how many are in it."""
        return len(self._items)

    def backlog(self) -> int:
        """Stand in for `EventQueue.backlog`."""
        return len(self._items)
