"""Reads that are made now and then: outputs or settings in a sweep, and by appointment."""

import heapq
from collections import deque
from collections.abc import Callable, Iterable

from bridge.line.plan.streams import Poll

IsHealthy = Callable[[int], bool]

# The sweep runs so much ahead of its time: an exchange or a command may come between.
AHEAD = 0.95
# What was missed while commands had the line is caught up with, up to so many reads.
_CATCH_UP = 4
# Appointments closer than this are one: so a flood of pulses makes no flood of reads.
_SLOT_S = 0.05


class Sweep:
    """The swept reads, evenly over the time, and appointments. Time is an argument."""

    def __init__(self, polls: Iterable[Poll], sweep_s: float) -> None:
        self._polls = deque(polls)  # the read that was made last stands last
        self._each_s = sweep_s * AHEAD / max(1, len(self._polls))
        self._next_at: float | None = None
        self._appointments: list[tuple[int, int, Poll]] = []

    def appoint(self, poll: Poll, at: float) -> None:
        """Note that this read is wanted once, at that instant or soon after."""
        slot = int(at / _SLOT_S) + 1
        if all((slot, poll) != (known, other) for known, _, other in self._appointments):
            heapq.heappush(self._appointments, (slot, poll.station, poll))

    def take(self, now: float, is_healthy: IsHealthy) -> Poll | None:
        """Return the read that is due: an appointment, else the next of the sweep."""
        while self._appointments and self._appointments[0][0] * _SLOT_S <= now:
            poll = heapq.heappop(self._appointments)[2]
            if is_healthy(poll.station):
                self._made(poll)
                return poll
        if self._next_at is None:
            self._next_at = now + self._each_s
        return self.any(now, is_healthy) if now >= self._next_at else None

    def any(self, now: float, is_healthy: IsHealthy) -> Poll | None:
        """Return the next of the sweep, due or not; None: no module is healthy."""
        for poll in self._polls:
            if is_healthy(poll.station):
                self._next_at = self._begun(now) + self._each_s
                self._made(poll)
                return poll
        return None

    def _begun(self, now: float) -> float:
        """From when on the next one is counted: this one's own time, if that is not far off.

        One that was made ahead of its time, as there was nothing else to read, counts from now on:
        many of those would else put off the sweep for as long as they are many.
        """
        due_at = now if self._next_at is None else self._next_at
        return min(max(due_at, now - _CATCH_UP * self._each_s), now)

    def _made(self, poll: Poll) -> None:
        if poll in self._polls:
            self._polls.remove(poll)
            self._polls.append(poll)
