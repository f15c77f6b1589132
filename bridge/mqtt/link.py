"""Judges by a loop-back ping whether what arrives is fresh. Time is an argument."""

from collections import deque

PING_INTERVAL_S = 1.0
STALE_AFTER_S = 3.0

# A ping sent more than 3 s ago proves nothing any more when it comes back.
_REMEMBERED = int(STALE_AFTER_S / PING_INTERVAL_S) + 1


class LinkCheck:
    """Knows how old a command may be that arrives now (FAILURES.md A3).

    The broker hands us pings and commands in the order in which it took them in. So a command
    that arrives after a ping came back was taken in after that ping was sent: it cannot be
    older than the newest ping that came back. The link is stale while that one was sent more
    than 3 s ago, which is never later than the moment when the oldest unanswered one is 3 s
    old. To judge by what did come back also covers pings that were never sent in time.
    """

    def __init__(self, nonce: str) -> None:
        self._nonce = nonce  # of this run: another bridge's ping is not ours
        self._count = 0
        self._sent: deque[tuple[bytes, float]] = deque(maxlen=_REMEMBERED)
        self._ping_due = 0.0
        self._fresh_from: float | None = None  # nothing that arrives was taken in before this

    def connected(self, at: float) -> None:
        """A connection without a past began: what arrives over it was taken in after `at`."""
        self._sent.clear()
        self._ping_due = at
        self._fresh_from = at

    def disconnected(self) -> None:
        """The connection ended."""
        self._fresh_from = None

    def ping(self, now: float) -> bytes | None:
        """Gives the payload of the ping that is to be sent now, or None: none is due."""
        if self._fresh_from is None or now < self._ping_due:
            return None
        self._count += 1
        payload = f"{self._nonce} {self._count}".encode()
        self._sent.append((payload, now))
        self._ping_due = now + PING_INTERVAL_S
        return payload

    def seen(self, payload: bytes) -> None:
        """Takes a ping that arrived."""
        for sent, at in self._sent:
            if sent == payload and self._fresh_from is not None:
                self._fresh_from = max(self._fresh_from, at)

    def stale(self, now: float) -> bool:
        """Whether something that arrives at `now` could be older than 3 s."""
        return self._fresh_from is None or now - self._fresh_from > STALE_AFTER_S
