"""Finds out whether commands can reach us. Time is an argument: monotonic seconds."""

from collections.abc import Iterable, Iterator

from bridge.mqtt.events import OutMessage

PROBE_EVERY_S = 60.0
LOST_AFTER_S = 5.0


class CommandProbe:
    """Publishes on one topic of each command filter, and tells which do not come back.

    An access list denies without a word: brokers grant a subscription and then deliver nothing
    (docs/failures.md B3). `bridge` stands for station and channel: it can't be a station's id, so a
    probe is no command. QoS 1, so that MQTT 5 says so where the publishing is denied.
    """

    def __init__(self, filters: Iterable[str], nonce: str) -> None:
        self._filters = {one.replace("+", "bridge"): one for one in filters if "+" in one}
        self._payload = nonce.encode()  # of this run: another bridge's probe is not ours
        self._lost: set[str] = set()
        self._awaited: set[str] = set()
        self._probe_at: float | None = None
        self._judge_at: float | None = None

    def connected(self, now: float) -> None:
        """Note that a connection began.

        What was sent over an earlier one is not awaited any more.
        """
        self._probe_at = now
        self._judge_at = None

    def due(self, now: float) -> Iterator[OutMessage]:
        """Return the probes that are to be sent now."""
        if self._probe_at is None or now < self._probe_at:
            return
        self._probe_at = now + PROBE_EVERY_S
        self._judge_at = now + LOST_AFTER_S
        self._awaited = set(self._filters)
        for topic in self._filters:
            yield OutMessage(topic, self._payload, qos=1, retain=False)

    def took(self, topic: str, payload: bytes) -> bool:
        """Return whether what arrived is a probe of ours."""
        if payload != self._payload or topic not in self._filters:
            return False
        self._awaited.discard(topic)
        return True

    def newly_lost(self, now: float) -> list[tuple[str, str]]:
        """Topics of probes that are overdue, with their filters: each once until it came back.

        Ask only while pings come back: else it is the link that is late.
        """
        if self._judge_at is None or now < self._judge_at:
            return []
        self._judge_at = None
        news = sorted(self._awaited - self._lost)
        self._lost = set(self._awaited)
        return [(topic, self._filters[topic]) for topic in news]
