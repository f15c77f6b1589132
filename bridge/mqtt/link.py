"""Decides by a loop-back ping whether arriving messages are fresh. Time is an argument."""

from collections import deque

PING_INTERVAL_S = 1.0
STALE_AFTER_S = 3.0
# A broker may deliver stored messages without their retain flag, directly after the first ping
# (F10).
SETTLING_S = 0.5
STALE_WORDS = "the link to the broker is not proven: it may have been on its way for long"

# A ping that was sent more than 3 s ago proves nothing when it comes back.
_REMEMBERED = int(STALE_AFTER_S / PING_INTERVAL_S) + 1


class LinkCheck:
    """Limits the age of arriving commands (docs/failures.md A3).

    The broker delivers pings and commands in the order in which it accepted them. So a command that
    arrives after a ping came back was accepted after that ping was sent: it cannot be older than
    the newest ping that came back. The link is stale if that ping was sent more than 3 s ago. This
    is never later than the moment at which the oldest unanswered ping is 3 s old, and it also
    covers pings that were not sent in time.

    A connection alone proves nothing: a broker may accept it and stay mute (F6), or deliver stored
    messages as new ones (F10). So a connection counts from its first returned ping.

    All instants are of `bridge.clock.boot_s`, which counts during a suspend. So after a suspend the
    link is stale until a ping comes back that was sent after it (F7).
    """

    def __init__(self, nonce: str) -> None:
        self._nonce = nonce  # of this run: the ping of another bridge differs
        self._count = 0
        self._sent: deque[tuple[bytes, float]] = deque(maxlen=_REMEMBERED)
        self._ping_due: float | None = None  # None: there is no connection
        self._settled_at: float | None = None  # None: no ping of this connection came back
        self._connected_at = 0.0
        self._fresh_from = 0.0  # nothing that arrives was accepted before this instant

    def connected(self, at: float) -> None:
        """Begin with the new connection made at `at`."""
        self.disconnected()
        self._ping_due = self._connected_at = at

    def suspended(self, now: float) -> None:
        """Require a new proof: the machine was suspended until `now`."""
        if self._ping_due is not None:
            self.connected(now)

    def disconnected(self) -> None:
        """Forget the connection: it ended."""
        self._sent.clear()
        self._ping_due = None
        self._settled_at = None

    def ping(self, now: float) -> bytes | None:
        """Return the payload of the ping to send now, or None: none is due."""
        if self._ping_due is None or now < self._ping_due:
            return None
        self._count += 1
        payload = f"{self._nonce} {self._count}".encode()
        self._sent.append((payload, now))
        self._ping_due = now + PING_INTERVAL_S
        return payload

    def seen(self, payload: bytes, at: float) -> None:
        """Handle a ping that arrived at `at`."""
        for sent, sent_at in self._sent:
            if sent != payload:
                continue
            if self._settled_at is None:
                self._settled_at = at + SETTLING_S
                self._fresh_from = sent_at
            self._fresh_from = max(self._fresh_from, sent_at)

    def answered_since(self, instant: float) -> bool:
        """Return whether a ping came back that was sent at `instant` or later."""
        return self._settled_at is not None and self._fresh_from >= instant

    def away(self, now: float) -> bool:
        """Return whether the broker is away: no ping of this connection came back for 3 s."""
        return self._settled_at is None or now - self._fresh_from > STALE_AFTER_S

    def mute(self, now: float) -> bool:
        """Return whether there is a connection, but no ping came back for 3 s."""
        proven_at = self._connected_at if self._settled_at is None else self._fresh_from
        return self._ping_due is not None and now - proven_at > STALE_AFTER_S

    def stale(self, now: float) -> bool:
        """Return whether a message that arrives at `now` may be old: then it must not switch."""
        return self._settled_at is None or now < self._settled_at or self.away(now)
