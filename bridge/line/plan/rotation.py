"""The rotation of reads: the one that was made longest ago comes first."""

from collections import deque
from collections.abc import Callable

from bridge.line.plan.streams import Poll, Streams

# A station of high priority is read this often while a normal one is read once.
HIGH_TIMES = 4
# A changed input is read again after this many other reads, and such reads are at most one in this
# many: half a round of a long line; on a short line its turn comes sooner anyway.
SOON = 12

IsHealthy = Callable[[int], bool]


class Rotation:
    """Laps: every station of high priority once, then a quarter of the normal ones.

    A station that changed is read out of turn, soon, and then waits for a whole round. This costs
    the others one read in `SOON`.
    """

    def __init__(self, streams: Streams) -> None:
        self._normal = deque(streams.normal)  # the last read is at the end
        self._high = deque(streams.high)
        self._is_short = not streams.high and len(streams.normal) <= SOON
        self._high_left = 0
        self._normal_left = 0
        self._changed: deque[tuple[int, Poll]] = deque()
        self._made = 0
        self._soon_from = 0

    def pop(self, is_healthy: IsHealthy) -> Poll | None:
        """Return the next read of a healthy station; None: there is none."""
        poll = self._out_of_turn(is_healthy) if self._changed else None
        if poll is None:
            poll = self._in_turn(is_healthy)
        self._made += 1
        return poll

    def changed(self, poll: Poll) -> None:
        """Request this read again soon: it found a change, and more may follow."""
        if self._is_short or poll in self._high:
            return
        if all(poll != waiting for _, waiting in self._changed):
            self._changed.append((self._made + SOON, poll))

    def _out_of_turn(self, is_healthy: IsHealthy) -> Poll | None:
        at, poll = self._changed[0]
        if self._made < max(at, self._soon_from):
            return None
        self._changed.popleft()
        if poll not in self._normal or not is_healthy(poll.address):
            return None
        self._soon_from = self._made + SOON
        self._normal.remove(poll)
        self._normal.append(poll)
        return poll

    def _in_turn(self, is_healthy: IsHealthy) -> Poll | None:
        if not self._high:
            return _rotate(self._normal, is_healthy)
        if not self._high_left and not self._normal_left:
            self._begin_lap(is_healthy)
        if self._high_left:
            self._high_left -= 1
            poll = _rotate(self._high, is_healthy)
        else:
            self._normal_left -= 1
            poll = _rotate(self._normal, is_healthy)
        # A station that was counted at the beginning of the lap may be gone.
        return poll or _rotate(self._normal, is_healthy) or _rotate(self._high, is_healthy)

    def _begin_lap(self, is_healthy: IsHealthy) -> None:
        normal = sum(is_healthy(poll.address) for poll in self._normal)
        self._high_left = sum(is_healthy(poll.address) for poll in self._high)
        self._normal_left = lap_of(normal) if normal or not self._high_left else 0


def lap_of(normal: int) -> int:
    """Return the normal reads between two reads of a high station, of `normal` in all."""
    return max(1, -(-normal // HIGH_TIMES))


def _rotate(polls: deque[Poll], is_healthy: IsHealthy) -> Poll | None:
    for poll in polls:
        if is_healthy(poll.address):
            polls.remove(poll)  # usually the first
            polls.append(poll)
            return poll
    return None
