"""The messages to send, bounded in any failure (docs/failures.md B6). Time is an argument."""

import zlib
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from bridge.mqtt.events import OutMessage

WINDOW = 64
MOST_HELD = 256
HOLD_S = 60.0
# While connected, verdicts wait only until the broker has accepted the earlier ones. All are kept
# in a flood of commands, because each command gets its verdict (docs/contract.md, promise 3).
MOST_WAITING = 16_384
MOST_WAITING_BYTES = 8 << 20  # of verdicts, with the data of their senders that they repeat
_MOST_FLEETING = 64
_REPEAT_EACH = 8
# An announcement of a device has up to 30 KB, and some 2 KB when it is packed.
_PACKED_FROM_BYTES = 2048

Send = Callable[[OutMessage], int | None]


@dataclass(frozen=True, slots=True)
class _HeldVerdict:
    serial: int
    message: OutMessage
    since: float

    @property
    def size(self) -> int:
        message = self.message
        return len(message.topic) + len(message.payload) + len(message.correlation or b"")


@dataclass(frozen=True, slots=True)
class _Unacknowledged:
    """A message without an acknowledgement, and when it was sent."""

    item: OutMessage | _HeldVerdict
    at: float


@dataclass(frozen=True, slots=True)
class _Packed:
    """A retained message with a long payload, which is kept packed."""

    packed: OutMessage

    def unpacked(self) -> OutMessage:
        return replace(self.packed, payload=zlib.decompress(self.packed.payload))


def _to_keep(message: OutMessage) -> OutMessage | _Packed:
    if len(message.payload) < _PACKED_FROM_BYTES:
        return message
    return _Packed(replace(message, payload=zlib.compress(message.payload)))


class Outbox:
    """The latest value of each retained topic, and the queue to the broker.

    Retained values are kept and sent again at each connect. A newer value replaces one that waits,
    at the same place in the queue. So no state is sent after the verdict that followed it, and a
    value that changes all the time does not wait for ever. Repeats for new subscribers (`again`)
    are sent when nothing new waits, or as every eighth message. Verdicts (QoS 1, not retained) are
    held while the broker is away: 256 of them, 60 s at most. Other messages with QoS 0 are sent now
    or dropped. The number of unacknowledged messages is limited to a window; QoS 0 does not count.

    Attributes:
        dropped_verdicts: The number of verdicts that were not delivered.
    """

    def __init__(self, window: int = WINDOW) -> None:
        self._window = window
        self._online = False
        self._retained: dict[str, OutMessage | _Packed] = {}
        self._waiting: OrderedDict[str | int, OutMessage | _HeldVerdict] = OrderedDict()
        self._waiting_verdicts: deque[_HeldVerdict] = deque()  # as in `_waiting`, in the same order
        self._waiting_bytes = 0  # of payloads and correlation data of verdicts
        self._repeats: OrderedDict[str, None] = OrderedDict()  # topics
        self._turn = 0
        self._fleeting: deque[OutMessage] = deque(maxlen=_MOST_FLEETING)
        self._unacknowledged: dict[int, _Unacknowledged] = {}  # by token, the oldest first
        self._serial = 0
        self.dropped_verdicts = 0

    @property
    def idle(self) -> bool:
        """Return whether the broker has everything that could be sent."""
        queued = self._waiting or self._unacknowledged or self._fleeting or self._repeats
        return not (self._online and queued)

    @property
    def repeating(self) -> bool:
        """Return whether repeats of `again` still wait."""
        return bool(self._repeats)

    @property
    def unacknowledged_since(self) -> float | None:
        """Return when the oldest message without an acknowledgement was sent, or None."""
        return next((sent.at for sent in self._unacknowledged.values()), None)

    def __len__(self) -> int:
        """Return the number of held messages."""
        queued = len(self._waiting) + len(self._fleeting) + len(self._unacknowledged)
        return len(self._retained) + queued

    def latest(self, topic: str) -> bytes | None:
        """Return the value of a retained topic as far as we know, or None."""
        message = self._kept(topic)
        return None if message is None else message.payload

    def put(self, message: OutMessage, now: float, *, at_end: bool = False) -> None:
        """Queue one message. A retained value that the topic already has is dropped.

        Args:
            message: The message.
            now: The instant (`bridge.clock.boot_s`).
            at_end: Send it after all waiting messages, even if its topic has a place in the queue:
                for a value that is only true after the others, such as `online`.
        """
        if message.retain:
            if self.latest(message.topic) != message.payload:
                self._retained[message.topic] = _to_keep(message)
                self._wait_with(message, at_end=at_end)
        elif message.qos > 0:
            self._put_verdict(message, now)
        elif self._online:
            self._fleeting.append(message)

    def again(self, topics: Iterable[str]) -> None:
        """Send the latest value of these topics once more, in this order, between new messages.

        A topic that already waits for its repeat keeps its place.
        """
        if not self._online:
            return  # at connect everything is sent
        for topic in topics:
            if topic in self._retained:
                self._repeats.setdefault(topic)

    def end_repeats(self) -> None:
        """Drop the repeats that still wait: the last values are on their way."""
        self._repeats.clear()

    def repeat_now(self, topic: str) -> None:
        """Send the latest value of a topic once more, like a new value."""
        message = self._kept(topic)
        if message is not None:
            self._wait_with(message, at_end=True)

    def _kept(self, topic: str) -> OutMessage | None:
        kept = self._retained.get(topic)
        return kept.unpacked() if isinstance(kept, _Packed) else kept

    def _wait_with(self, message: OutMessage, *, at_end: bool) -> None:
        if self._online:
            self._waiting[message.topic] = message  # at its place in the queue, if it has one
            if at_end:
                self._waiting.move_to_end(message.topic)

    def forget(self, topics: Iterable[str]) -> None:
        """Forget the values of these topics. Messages on their way are not cancelled."""
        for topic in topics:
            self._retained.pop(topic, None)
            self._waiting.pop(topic, None)
            self._repeats.pop(topic, None)

    def connected(self, order: Iterable[str], now: float) -> None:
        """Send every retained value, those in `order` last; then the held verdicts."""
        self.disconnected(now)
        self._online = True
        last = [topic for topic in order if topic in self._retained]
        for topic in (*self._retained, *last):
            self.repeat_now(topic)
        for verdict in self._waiting_verdicts:
            self._waiting.move_to_end(verdict.serial)

    def disconnected(self, now: float) -> None:
        """Record that the broker is gone: unacknowledged messages may not have arrived."""
        self._online = False
        self._fleeting.clear()
        self._repeats.clear()
        sent = (one.item for one in self._unacknowledged.values())
        lost = (item for item in sent if isinstance(item, _HeldVerdict))
        held = sorted((*lost, *self._waiting_verdicts), key=lambda verdict: verdict.serial)
        self._unacknowledged.clear()
        self._waiting = OrderedDict((verdict.serial, verdict) for verdict in held)
        self._waiting_verdicts = deque(held)
        self._waiting_bytes = sum(verdict.size for verdict in held)
        self._drop_verdicts(now)

    def acknowledged(self, token: int) -> None:
        """Record that the broker acknowledged the message to which `send` gave this token."""
        sent = self._unacknowledged.pop(token, None)
        if sent is not None and isinstance(sent.item, OutMessage) and not sent.item.payload:
            self._forget(sent.item)

    def _forget(self, cleared: OutMessage) -> None:
        if self._retained.get(cleared.topic) is cleared:  # no newer value came meanwhile
            del self._retained[cleared.topic]
            self._repeats.pop(cleared.topic, None)

    def pump(self, send: Send, now: float) -> None:
        """Send the messages that may be sent now. `send` returns None without a connection."""
        self._drop_verdicts(now)
        while self._fleeting:
            send(self._fleeting.popleft())
        while self._has_room() and (item := self._next()) is not None:
            token = send(item.message if isinstance(item, _HeldVerdict) else item)
            if token is None:
                return  # the event that reports it is on its way
            self._left(item)
            if isinstance(item, _HeldVerdict) or item.qos > 0:  # the broker acknowledges no other
                self._unacknowledged[token] = _Unacknowledged(item, now)

    def _has_room(self) -> bool:
        return self._online and len(self._unacknowledged) < self._window

    def _next(self) -> OutMessage | _HeldVerdict | None:
        self._turn += 1
        if not self._waiting or self._turn % _REPEAT_EACH == 0:
            # A new value takes the place of its arrival: `online` comes after states.
            while self._repeats and (topic := next(iter(self._repeats))) in self._waiting:
                del self._repeats[topic]
            if self._repeats:
                return self._kept(next(iter(self._repeats)))
        return next(iter(self._waiting.values()), None)

    def _left(self, item: OutMessage | _HeldVerdict) -> None:
        if isinstance(item, _HeldVerdict):
            del self._waiting[item.serial]
            self._waiting_verdicts.popleft()
            self._waiting_bytes -= item.size
            return
        self._waiting.pop(item.topic, None)
        self._repeats.pop(item.topic, None)

    def _put_verdict(self, message: OutMessage, now: float) -> None:
        self._serial += 1
        verdict = _HeldVerdict(self._serial, message, now)
        self._waiting[verdict.serial] = verdict
        self._waiting_verdicts.append(verdict)
        self._waiting_bytes += verdict.size
        self._drop_verdicts(now)

    def _drop_verdicts(self, now: float) -> None:
        waiting = self._waiting_verdicts
        while waiting and (self._too_many() or now - waiting[0].since > HOLD_S):
            dropped = waiting.popleft()
            del self._waiting[dropped.serial]
            self._waiting_bytes -= dropped.size
            self.dropped_verdicts += 1

    def _too_many(self) -> bool:
        most = MOST_WAITING if self._online else MOST_HELD
        return len(self._waiting_verdicts) > most or self._waiting_bytes > MOST_WAITING_BYTES
