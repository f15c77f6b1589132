"""The times at which the link from the commander to the bridge was whole.

No I/O and no threads here. Instants are of `time.monotonic`.
"""

from collections import deque

# What was on its way when the link went may be lost with it: sent so long before.
ON_ITS_WAY_S = 3.0
ON_ITS_WAY_BACK_S = 0.5
PROVEN_AFTER_S = 5.0  # so long after a suspend its link may not be proven


class Link:
    """The state of the link to the bridge, by the bridge's own pings."""

    def __init__(self) -> None:
        self._broken_since: float | None = None
        self._mended_at: float | None = None
        self._troubles = 0
        self._pings: deque[float] = deque(maxlen=1000)
        self._suspends: deque[tuple[float, float]] = deque(maxlen=1000)
        self._spans: deque[tuple[float, float]] = deque(maxlen=200)

    @property
    def whole(self) -> bool:
        """Return whether no fault of the link is known."""
        return self._broken_since is None

    def broken(self, now: float) -> None:
        """Something is done to the link."""
        self._broken_since = self._broken_since or now
        self._mended_at = None
        self._troubles += 1

    def mended(self, now: float) -> None:
        """Note the repair: the ping after the next shows that the bridge is back."""
        self._troubles -= 1
        if not self._troubles:
            self._mended_at = now

    def suspended(self, now: float, for_s: float) -> None:
        """The clock of the bridge was moved on."""
        self._suspends.append((now, for_s))

    def heard_before(self, at: float) -> tuple[float, float]:
        """Return when its last ping before an instant came, and what its clock counts since.

        While the link is whole nothing counts: it is not away. A ping that has just come to us may
        not have come back to the bridge. After a suspend the link has to be proven anew, and one
        that is suspended again by then was away for as long as it slept.
        """
        lately = sum(at - 2 * PROVEN_AFTER_S <= woke_at <= at for woke_at, _ in self._suspends)
        if not self.disturbed(at) and lately < 2:  # one alone is no loss
            return at, 0.0
        heard = max((ping for ping in self._pings if ping <= at - ON_ITS_WAY_BACK_S), default=0.0)
        slept_s = sum(for_s for woke_at, for_s in self._suspends if heard < woke_at <= at)
        return heard, at - heard + slept_s

    def ping(self, now: float) -> None:
        """A ping of the bridge passed."""
        self._pings.append(now)
        if self._broken_since and self._mended_at and now > self._mended_at + 1.0:
            self._spans.append((self._broken_since - ON_ITS_WAY_S, now + 1.0))
            self._broken_since = self._mended_at = None

    def disturbed(self, at: float) -> bool:
        """Return whether a message sent at that instant may not have arrived."""
        if self._broken_since is not None and at >= self._broken_since - ON_ITS_WAY_S:
            return True
        return any(begin <= at <= end for begin, end in self._spans)
