"""Judges by a loop-back ping whether what arrives is fresh. Time is an argument."""

from collections import deque

PING_INTERVAL_S = 1.0
STALE_AFTER_S = 3.0
# What a broker stored may come without its retain flag, right behind the first ping (F10).
SETTLING_S = 0.5
STALE_WORDS = "the link to the broker is not proven: it may have been on its way for long"

# A ping sent more than 3 s ago proves nothing any more when it comes back.
_REMEMBERED = int(STALE_AFTER_S / PING_INTERVAL_S) + 1


class LinkCheck:
    """Knows how old a command may be that arrives now (docs/failures.md A3).

    The broker hands us pings and commands in the order in which it took them in. So a command
    that arrives after a ping came back was taken in after that ping was sent: it cannot be
    older than the newest ping that came back. The link is stale while that one was sent more
    than 3 s ago, which is never later than the moment when the oldest unanswered one is 3 s
    old. To judge by what did come back also covers pings that were never sent in time.

    A connection proves nothing by itself: a broker may take it and be mute (F6), or deliver
    what it stored as if it were new (F10). So it counts from its first ping that came back.

    All instants are of `bridge.clock.boot_s`, which goes on while the machine is suspended: so a
    suspend makes the link stale until a ping that was sent after it comes back (F7).
    """

    def __init__(self, nonce: str) -> None:
        self._nonce = nonce  # of this run: another bridge's ping is not ours
        self._count = 0
        self._sent: deque[tuple[bytes, float]] = deque(maxlen=_REMEMBERED)
        self._ping_due: float | None = None  # None: there is no connection
        self._settled_at: float | None = None  # None: no ping of this connection came back
        self._connected_at = 0.0
        self._fresh_from = 0.0  # nothing that arrives was taken in before this

    def connected(self, at: float) -> None:
        """Begin anew: a connection without a past was made at `at`."""
        self.disconnected()
        self._ping_due = self._connected_at = at

    def suspended(self, now: float) -> None:
        """Prove the connection anew: the machine was suspended until `now`."""
        if self._ping_due is not None:
            self.connected(now)

    def disconnected(self) -> None:
        """Forget the connection: it ended."""
        self._sent.clear()
        self._ping_due = None
        self._settled_at = None

    def ping(self, now: float) -> bytes | None:
        """Return the payload of the ping that is to be sent now, or None: none is due."""
        if self._ping_due is None or now < self._ping_due:
            return None
        self._count += 1
        payload = f"{self._nonce} {self._count}".encode()
        self._sent.append((payload, now))
        self._ping_due = now + PING_INTERVAL_S
        return payload

    def seen(self, payload: bytes, at: float) -> None:
        """Take a ping that arrived at `at`."""
        for sent, sent_at in self._sent:
            if sent != payload:
                continue
            if self._settled_at is None:
                self._settled_at = at + SETTLING_S
                self._fresh_from = sent_at
            self._fresh_from = max(self._fresh_from, sent_at)

    def away(self, now: float) -> bool:
        """Tell whether the broker is away: no ping of this connection came back for 3 s."""
        return self._settled_at is None or now - self._fresh_from > STALE_AFTER_S

    def mute(self, now: float) -> bool:
        """Tell whether a connection is there, and no ping came back for 3 s."""
        proven_at = self._connected_at if self._settled_at is None else self._fresh_from
        return self._ping_due is not None and now - proven_at > STALE_AFTER_S

    def stale(self, now: float) -> bool:
        """Tell whether something that arrives at `now` may be old: then nothing switches by it."""
        return self._settled_at is None or now < self._settled_at or self.away(now)
