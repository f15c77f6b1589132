"""Properties of a broker that were learned by trying; they are kept over connections."""

from collections import Counter
from dataclasses import replace
from typing import Final

from bridge.mqtt.events import OutMessage
from bridge.mqtt.refusals import NO_QOS, NO_RETAIN

# Brokers that limit the filters of one SUBSCRIBE allow at least 8 (AWS IoT).
MOST_FILTERS: Final = 8
_SUSPECT_BYTES = 512  # no broker refuses shorter packets: such a cut has another cause
_MOST_TOPICS = 1000  # a requester chooses response topics: the memory is limited
_CUTS = 2  # at the same message: the first may be an accident


class BrokerMemory:
    """Remembers what this broker does not accept. The thread of the client owns it.

    A message that is longer than every acknowledged one is sent alone: no other follows until it is
    acknowledged. If the connection ends twice before that, messages of this length are left out
    from then on, because each attempt would cut the connection again (docs/failures.md F18).

    Attributes:
        filters: The number of filters for one SUBSCRIBE.
        wildcards: Filters may have wildcards.
    """

    def __init__(self) -> None:
        self.filters = MOST_FILTERS
        self._will_retain = True
        self._will_qos = 2
        self.wildcards = True
        self._taken_bytes = _SUSPECT_BYTES
        self._cutting_bytes: int | None = None
        self._cuts: Counter[str] = Counter()
        self._left_out: set[str] = set()

    def is_untried(self, size_bytes: int) -> bool:
        """Return whether the broker never acknowledged a packet of this length."""
        return size_bytes > self._taken_bytes

    def cuts(self, size_bytes: int) -> bool:
        """Return whether a packet of this length is known to cut the connection."""
        return self._cutting_bytes is not None and size_bytes >= self._cutting_bytes

    def took(self, size_bytes: int) -> None:
        """Record that the broker acknowledged a packet of this length."""
        self._taken_bytes = max(self._taken_bytes, size_bytes)

    def cut(self, topic: str, size_bytes: int, *, said: bool) -> bool:
        """Record that the connection ended while only this message was unacknowledged.

        Args:
            topic: Its topic.
            size_bytes: The length of its packet.
            said: The broker said that it was too large.

        Returns:
            Whether such messages are left out from now on.
        """
        self._cuts[topic] += 1
        known = self._cutting_bytes is not None
        if not (said or known or self._cuts[topic] >= _CUTS):
            return False
        self._cutting_bytes = min(size_bytes, self._cutting_bytes or size_bytes)
        self._cuts.clear()
        return True

    def is_news(self, topic: str) -> bool:
        """Return whether a message to this topic is left out for the first time."""
        if topic in self._left_out or len(self._left_out) >= _MOST_TOPICS:
            return False
        self._left_out.add(topic)
        return True

    def refused(self, code: int) -> None:
        """Record that the broker refused CONNECT: the last will may be the cause."""
        if code == NO_RETAIN:
            self._will_retain = False
        elif code == NO_QOS:
            self._will_qos = 0

    def allowed_will(self, will: OutMessage | None) -> OutMessage | None:
        """Return the last will in a form that this broker accepts."""
        if will is None:
            return None
        retain = will.retain and self._will_retain
        return replace(will, retain=retain, qos=min(will.qos, self._will_qos))

    def closed_at_subscribe(self) -> None:
        """Record that the broker closed the connection at SUBSCRIBE: ask for fewer filters."""
        self.filters = max(1, self.filters // 2)
