"""One look at what the broker retains of ours. Time is an argument: monotonic seconds."""

from collections.abc import Callable, Mapping

from bridge.mqtt.events import Received

# What is retained follows the broker's answer to the subscription, one message after the other.
QUIET_S = 0.3
LONGEST_S = 5.0
# A full broker must not fill our memory: a full bridge has about 4,000 topics, and what it finds
# of its own announcements after an upgrade is as long as these are.
MOST_TOPICS = 50_000
MOST_BYTES = 2 << 20  # and as much as we would publish


class Survey:
    """Begins with a subscription, and is over when nothing that is retained comes any more.

    `concerns` tells which topics are worth remembering; `ours` is what we would put on some of
    them. Where the broker has just that, it is not held twice: it may be a megabyte.

    Attributes:
        retained: What was found.
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
        """Return whether the broker answered, had said everything when it was over.

        And all was kept.
        """
        return self._quiet_at is not None and self._quiet_at <= self._ends_at and not self._is_full

    def answered(self, now: float) -> None:
        """Note that the broker took the subscription, or refused it: then nothing will come."""
        self._quiet_at = now + QUIET_S

    def take(self, received: Received, now: float) -> None:
        """Something arrived that no one else takes."""
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
        """Return whether there is no more to wait for."""
        return now >= self._ends_at or (self._quiet_at is not None and now >= self._quiet_at)
