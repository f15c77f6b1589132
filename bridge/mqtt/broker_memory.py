"""What was learned of a broker by trying: it outlives the connections."""

from collections import Counter
from dataclasses import replace
from typing import Final

from bridge.mqtt.events import OutMessage
from bridge.mqtt.refusals import NO_QOS, NO_RETAIN

# Brokers that bound what one SUBSCRIBE may ask for allow 8 (AWS IoT); none that is known, fewer.
MOST_FILTERS: Final = 8
_SUSPECT_BYTES = 512  # no broker refuses less: a cut while less was on its way has another cause
_MOST_TOPICS = 1000  # a requester chooses response topics: what is remembered is bounded
_CUTS = 2  # by one message: the first may be an accident


class BrokerMemory:
    """Remembers what this broker does not take. The client's thread owns it.

    While a message is on its way that is longer than all that the broker acknowledged so far, no
    other follows: of what is under way it alone may be too large. If the connection ends before it
    is acknowledged, twice, messages of this length are left out from then on: each attempt would
    cut the connection again (docs/failures.md F18).

    Attributes:
        filters: How many filters one SUBSCRIBE may ask for.
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
        """Tell whether the broker never acknowledged a packet of this length."""
        return size_bytes > self._taken_bytes

    def cuts(self, size_bytes: int) -> bool:
        """Tell whether a packet of this length is known to cut the connection."""
        return self._cutting_bytes is not None and size_bytes >= self._cutting_bytes

    def took(self, size_bytes: int) -> None:
        """The broker acknowledged a packet of this length."""
        self._taken_bytes = max(self._taken_bytes, size_bytes)

    def cut(self, topic: str, size_bytes: int, *, said: bool) -> bool:
        """Return what follows when the connection ended while this message alone was on its way.

        Args:
            topic: Where it went.
            size_bytes: How long the packet was.
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
        """Tell whether a message to this topic is left out for the first time."""
        if topic in self._left_out or len(self._left_out) >= _MOST_TOPICS:
            return False
        self._left_out.add(topic)
        return True

    def refused(self, code: int) -> None:
        """The broker refused CONNECT: it may not like the last will."""
        if code == NO_RETAIN:
            self._will_retain = False
        elif code == NO_QOS:
            self._will_qos = 0

    def allowed_will(self, will: OutMessage | None) -> OutMessage | None:
        """Return the last will as this broker takes it."""
        if will is None:
            return None
        retain = will.retain and self._will_retain
        return replace(will, retain=retain, qos=min(will.qos, self._will_qos))

    def closed_at_subscribe(self) -> None:
        """The broker closed the connection in place of answering SUBSCRIBE: ask for less."""
        self.filters = max(1, self.filters // 2)
