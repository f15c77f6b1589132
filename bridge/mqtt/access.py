"""Finds out whether commands can reach the bridge. Time is an argument (`bridge.clock.boot_s`)."""

from collections.abc import Iterable, Iterator

from bridge.mqtt.events import OutMessage

PROBE_EVERY_S = 60.0
LOST_AFTER_S = 5.0


class CommandProbe:
    """Publishes on one topic of each command filter, and reports those that do not come back.

    An access list often denies silently: the broker grants a subscription and then delivers nothing
    (docs/failures.md B3). The probe uses `bridge` in place of a station: no station can have this
    id, so a probe is not a command. QoS 1, so that MQTT 5 reports a denied publication.
    """

    def __init__(self, filters: Iterable[str], nonce: str) -> None:
        self._filters = {one.replace("+", "bridge"): one for one in filters if "+" in one}
        self._payload = nonce.encode()  # of this run: the probe of another bridge differs
        self._lost: set[str] = set()
        self._awaited: set[str] = set()
        self._probe_at: float | None = None
        self._judge_at: float | None = None

    def connected(self, now: float) -> None:
        """Begin with a new connection; probes on an earlier one are no longer expected."""
        self._probe_at = now
        self._judge_at = None

    def due(self, now: float) -> Iterator[OutMessage]:
        """Yield the probes that are to be sent now."""
        if self._probe_at is None or now < self._probe_at:
            return
        self._probe_at = now + PROBE_EVERY_S
        self._judge_at = now + LOST_AFTER_S
        self._awaited = set(self._filters)
        for topic in self._filters:
            yield OutMessage(topic, self._payload, qos=1, retain=False)

    def took(self, topic: str, payload: bytes) -> bool:
        """Return whether a message is one of our probes."""
        if payload != self._payload or topic not in self._filters:
            return False
        self._awaited.discard(topic)
        return True

    def newly_lost(self, now: float) -> list[tuple[str, str]]:
        """Return topic and filter of each overdue probe, once until it came back.

        Call it only while pings come back: else the link is late, and not the probe.
        """
        if self._judge_at is None or now < self._judge_at:
            return []
        self._judge_at = None
        news = sorted(self._awaited - self._lost)
        self._lost = set(self._awaited)
        return [(topic, self._filters[topic]) for topic in news]
