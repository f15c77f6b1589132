"""Reads that are made now and then: outputs or settings in a sweep, and appointments."""

import heapq
from collections import deque
from collections.abc import Callable, Iterable

from bridge.line.plan.streams import Poll

IsHealthy = Callable[[int], bool]

# The sweep is ahead of its time by this much: an exchange or a command may come between.
AHEAD = 0.95
# After a time of commands, up to this many missed reads are made up for.
_CATCH_UP = 4
# Appointments closer than this are merged, so many pulses do not cause many reads.
_SLOT_S = 0.05


class Sweep:
    """The reads of a sweep, evenly spread over its time, and appointments. Time is an argument."""

    def __init__(self, polls: Iterable[Poll], sweep_s: float) -> None:
        self._polls = deque(polls)  # the last read is at the end
        self._each_s = sweep_s * AHEAD / max(1, len(self._polls))
        self._next_at: float | None = None
        self._appointments: list[tuple[int, int, Poll]] = []

    def appoint(self, poll: Poll, at: float) -> None:
        """Request this read once, at that instant or soon after."""
        slot = int(at / _SLOT_S) + 1
        if all((slot, poll) != (known, other) for known, _, other in self._appointments):
            heapq.heappush(self._appointments, (slot, poll.address, poll))

    def pop(
        self, now: float, is_healthy: IsHealthy, is_free: IsHealthy | None = None
    ) -> Poll | None:
        """Return the read that is due: an appointment, else the next of the sweep.

        Only stations that are free are read: None stands for all healthy ones.
        """
        is_free = is_free or is_healthy
        while self._appointments and self._appointments[0][0] * _SLOT_S <= now:
            poll = heapq.heappop(self._appointments)[2]
            if is_free(poll.address):
                self._made(poll)
                return poll
            if is_healthy(poll.address):
                self.appoint(poll, now + _SLOT_S)  # never in a slot that is due
        if self._next_at is None:
            self._next_at = now + self._each_s
        return self.any(now, is_free) if now >= self._next_at else None

    def any(self, now: float, is_healthy: IsHealthy) -> Poll | None:
        """Return the next read of the sweep, due or not; None: no module is healthy."""
        for poll in self._polls:
            if is_healthy(poll.address):
                self._next_at = self._begun(now) + self._each_s
                self._made(poll)
                return poll
        return None

    def _begun(self, now: float) -> float:
        """Return the time from which the next read is counted: its planned time, if that is near.

        A read that was made early, because nothing else was due, counts from now. Otherwise many
        early reads would delay the sweep.
        """
        due_at = now if self._next_at is None else self._next_at
        return min(max(due_at, now - _CATCH_UP * self._each_s), now)

    def _made(self, poll: Poll) -> None:
        if poll in self._polls:
            self._polls.remove(poll)
            self._polls.append(poll)
