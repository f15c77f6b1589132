"""Sends messages over one connection, in the form that the broker accepts."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

from bridge.bounded_log import BoundedLog, Cause
from bridge.clock import boot_s
from bridge.mqtt import refusals
from bridge.mqtt.broker_limits import BrokerLimits, packet_bytes
from bridge.mqtt.broker_memory import BrokerMemory
from bridge.mqtt.closing import Blamed
from bridge.mqtt.counters import Counters
from bridge.mqtt.events import OutMessage
from bridge.mqtt.refusals import Answer

# The same logger as the client: what it says of the broker is not published through the broker.
_KINDS = {
    *("state", "info", "availability", "diagnostics", "problem", "result", "config", "set"),
    *("di", "do", "mode", "hold", "count", "event", "own_actions"),
}

# A message that may be too large is sent alone; after this time without an answer others follow.
_ALONE_S = 2.0
_WINDOW = 100  # unacknowledged QoS 1 messages; a v5 broker may allow fewer
_NAMED_TOPICS = 1000  # a requester chooses response topics: the memory is limited
_TOPIC_CHARS = 128  # of such a one, in the log


@dataclass(frozen=True, slots=True)
class Offer:
    """A message to send; `token` identifies it."""

    token: int
    message: OutMessage
    size_bytes: int


@dataclass(frozen=True, slots=True)
class _Sent:
    """An unanswered message; without `token` its answer is not reported."""

    token: int | None
    topic: str
    size_bytes: int  # 0: the answer says nothing about it


class SendWindow:
    """Keeps the window, and the limits of the broker. The thread of the connection owns it."""

    def __init__(
        self,
        write: Callable[[OutMessage], tuple[int, bool]],
        acknowledged: Callable[[int], None],
        memory: BrokerMemory,
        counters: Counters,
        log: BoundedLog,
        *,
        has_properties: bool,
    ) -> None:
        """Create it; `write` sends a message and returns its id and whether it is written."""
        self._write = write
        self._acknowledged = acknowledged
        self._memory = memory
        self._counters = counters
        self._log = log
        self._has_properties = has_properties
        self._limits = BrokerLimits()
        self._window = _WINDOW
        self._unanswered: dict[int, _Sent] = {}  # by message id
        self._alone: int | None = None  # message id of one that may be too large for the broker
        self._alone_until = 0.0
        self._named: set[str] = set()

    @property
    def idle(self) -> bool:
        """Return whether every message is answered."""
        return not self._unanswered

    def limit(self, limits: BrokerLimits) -> None:
        """Use the limits of the broker."""
        self._limits = limits
        self._window = min(_WINDOW, limits.window)

    def offer(self, token: int, message: OutMessage) -> Offer:
        """Return an offer of a message. For any thread."""
        return Offer(token, message, packet_bytes(message, has_properties=self._has_properties))

    @property
    def has_room(self) -> bool:
        """Return whether one more message may be sent now."""
        if self._alone is not None and boot_s() < self._alone_until:
            return False
        return len(self._unanswered) < self._window

    def publish(self, offer: Offer) -> None:
        """Send a message, or leave it out."""
        message = self._limits.allowed(offer.message)
        if message is None or self._is_too_large(offer):
            self._answer(offer)
            return
        untried = self._is_untried(offer)
        if untried:
            message = replace(message, qos=1)  # QoS 0 would not show whether the broker accepted it
        try:
            message_id, written = self._write(message)
        except ValueError as error:  # a topic that MQTT does not allow
            self._refused(message.topic, str(error))
            self._answer(offer)
            return
        if written:
            self._answer(offer)
        elif message.qos or offer.message.qos:
            token = offer.token if offer.message.qos else None
            size_bytes = offer.size_bytes if message.qos else 0
            self._unanswered[message_id] = _Sent(token, message.topic, size_bytes)
            if untried:
                self._alone, self._alone_until = message_id, boot_s() + _ALONE_S

    def published(self, message_id: int, answer: Answer) -> None:
        """Record that a message is written (QoS 0) or answered."""
        sent = self._unanswered.pop(message_id, None)
        if sent is None:  # QoS 0, and nothing waits for it
            return
        if message_id == self._alone:
            self._alone = None
        if answer.code == refusals.PACKET_TOO_LARGE:
            self._memory.cut(sent.topic, sent.size_bytes, said=True)
            self._leave_out(sent.topic, sent.size_bytes)
        else:
            self._memory.took(sent.size_bytes)
            if answer.is_failure:
                self._refused(sent.topic, answer.told)
        if sent.token is not None:
            self._acknowledged(sent.token)

    def blame(self, answer: Answer) -> Blamed | None:
        """Return the message that probably ended the connection, if any."""
        if self._alone is None or answer.code == refusals.KEEPALIVE_TIMEOUT:
            return None
        sent = self._unanswered[self._alone]
        said = answer.code == refusals.PACKET_TOO_LARGE
        return Blamed(
            sent.topic, sent.size_bytes, self._memory.cut(sent.topic, sent.size_bytes, said=said)
        )

    def _is_untried(self, offer: Offer) -> bool:
        return self._limits.qos > 0 and self._memory.is_untried(offer.size_bytes)

    def _is_too_large(self, offer: Offer) -> bool:
        most = self._limits.packet_bytes
        fits = most is None or offer.size_bytes <= most
        if fits and not self._memory.cuts(offer.size_bytes):
            return False
        self._leave_out(offer.message.topic, offer.size_bytes)
        return True

    def _answer(self, offer: Offer) -> None:
        """Report that this message is finished."""
        if offer.message.qos:
            self._acknowledged(offer.token)

    def _leave_out(self, topic: str, size_bytes: int) -> None:
        self._counters.failed_publishes += 1
        if self._memory.is_news(topic):
            what = f"left out a message of {size_bytes} bytes to {topic[:_TOPIC_CHARS]!r}"
            advice = refusals.advice(refusals.PACKET_TOO_LARGE)
            line = f"{what}: too large for the broker; {advice}"
            self._log.tell(Cause.MESSAGE, "out", logging.WARNING, line)

    def _refused(self, topic: str, reason: str) -> None:
        self._counters.failed_publishes += 1
        if topic not in self._named and len(self._named) < _NAMED_TOPICS:
            self._named.add(topic)
            text = f"the broker did not take a message to {topic!r}: {reason}"
            self._log.tell(Cause.BROKER_DENIES, _kind_of(topic), logging.WARNING, text)


def _kind_of(topic: str) -> str:
    """Return the kind of a topic.

    So an access list that denies one kind to all stations does not hide other kinds.
    """
    levels = [level for level in topic.split("/")[-2:] if not level.isdecimal()]
    return levels[-1] if levels and levels[-1] in _KINDS else ""
