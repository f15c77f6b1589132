"""One look at what the broker retains of ours. Time is an argument: monotonic seconds."""

from collections.abc import Callable, Mapping

from bridge.mqtt.events import Received

# What is retained follows the broker's answer to the subscription, one message after the other.
QUIET_S = 0.3
LONGEST_S = 5.0
MOST_TOPICS = 50_000  # a full bridge has about 4,000: whoever fills the broker fills not us


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
        self._ends_at = now + LONGEST_S
        self._quiet_at: float | None = None  # None: the broker has not answered yet

    @property
    def is_whole(self) -> bool:
        """Whether the broker answered, and had said everything when it was over."""
        return self._quiet_at is not None and self._quiet_at <= self._ends_at

    def answered(self, now: float) -> None:
        """The broker took the subscription, or refused it: then nothing will come."""
        self._quiet_at = now + QUIET_S

    def take(self, received: Received, now: float) -> None:
        """Something arrived that nobody else cares for."""
        if not received.retain:
            return
        if self._quiet_at is not None:
            self._quiet_at = now + QUIET_S
        if self._concerns(received.topic) and len(self.retained) < MOST_TOPICS:
            ours = self._ours.get(received.topic)
            self.retained[received.topic] = ours if ours == received.payload else received.payload

    def is_over(self, now: float) -> bool:
        """Whether there is no more to wait for."""
        return now >= self._ends_at or (self._quiet_at is not None and now >= self._quiet_at)
