"""Reads what the broker retains of ours. Time is an argument (`bridge.clock.boot_s`)."""

from collections.abc import Callable, Mapping

from bridge.mqtt.events import Received

# Retained messages follow the answer to the subscription, one directly after the other.
QUIET_S = 0.3
LONGEST_S = 5.0
# A full broker must not fill our memory. A bridge with all channels has about 4,000 topics, and old
# announcements of an earlier release are as long as the present ones.
MOST_TOPICS = 50_000
MOST_BYTES = 2 << 20  # plus the size of what we would publish


class Survey:
    """One reading: it begins with a subscription, and ends when no more retained messages come.

    `concerns` returns whether a topic is needed. `ours` is what we would publish on some of them:
    an equal payload is not stored twice, because this can be a megabyte.

    Attributes:
        retained: The messages that were found.
    """

    def __init__(
        self, concerns: Callable[[str], bool], ours: Mapping[str, bytes], now: float
    ) -> None:
        self.retained: dict[str, bytes] = {}
        self._concerns = concerns
        self._ours = ours
        self._rest_bytes = MOST_BYTES + sum(map(len, ours.values()))
        self._is_full = False
        self._ends_at = now + LONGEST_S
        self._quiet_at: float | None = None  # None: the broker has not answered yet

    @property
    def is_whole(self) -> bool:
        """Return whether the reading is complete: answered, not cut short, and all was stored."""
        return self._quiet_at is not None and self._quiet_at <= self._ends_at and not self._is_full

    def answered(self, now: float) -> None:
        """Record that the broker answered the subscription; after a refusal nothing will come."""
        self._quiet_at = now + QUIET_S

    def receive(self, received: Received, now: float) -> None:
        """Handle a message that belongs to no other part."""
        if not received.retain:
            return
        if self._quiet_at is not None:
            self._quiet_at = now + QUIET_S
        if self._concerns(received.topic):
            self._keep(received)

    def _keep(self, received: Received) -> None:
        ours = self._ours.get(received.topic)
        is_ours = ours == received.payload
        size_bytes = len(received.topic) + (0 if is_ours else len(received.payload))
        if len(self.retained) >= MOST_TOPICS or size_bytes > self._rest_bytes:
            self._is_full = True
            return
        self._rest_bytes -= size_bytes
        self.retained[received.topic] = ours if is_ours and ours is not None else received.payload

    def is_over(self, now: float) -> bool:
        """Return whether no more messages are expected."""
        return now >= self._ends_at or (self._quiet_at is not None and now >= self._quiet_at)
