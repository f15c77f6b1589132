"""What is to go out, bounded whatever fails (docs/failures.md B6). Time is an argument."""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from bridge.mqtt.events import OutMessage

WINDOW = 64
MOST_HELD = 256
HOLD_S = 60.0
# Connected, verdicts wait only until the broker has taken those before: a flood of commands is
# answered in full, since each command gets its verdict (docs/contract.md, promise 3).
MOST_WAITING = 16_384
MOST_WAITING_BYTES = 8 << 20  # of verdicts, with what their senders gave us to repeat
_MOST_FLEETING = 64
_REPEAT_EACH = 8

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


class Outbox:
    """The latest value of each retained topic, and the queue to the broker.

    Retained values are kept for ever and go out again at each connect. A newer value takes the
    place of one that still waits, where that stands: so no state goes behind a verdict that
    followed it, and none that changes all the time waits for ever. What is repeated for programs
    that come (`again`) goes when nothing new waits, or as each eighth message. Verdicts (QoS 1,
    not retained) are held while the broker is away, 256 and 60 s at the most. QoS 0 that is not
    retained is for what may be missed: it goes out now or never. At most a window of messages is
    with the broker unacknowledged; one with QoS 0 never is.

    Attributes:
        dropped_verdicts: How many verdicts that were not delivered.
    """

    def __init__(self, window: int = WINDOW) -> None:
        self._window = window
        self._online = False
        self._retained: dict[str, OutMessage] = {}
        self._waiting: OrderedDict[str | int, OutMessage | _HeldVerdict] = OrderedDict()
        self._waiting_verdicts: deque[_HeldVerdict] = deque()  # the same, in the same order
        self._waiting_bytes = 0  # of their payloads and correlation data
        self._repeats: OrderedDict[str, None] = OrderedDict()  # topics
        self._turn = 0
        self._fleeting: deque[OutMessage] = deque(maxlen=_MOST_FLEETING)
        self._unacknowledged: dict[int, OutMessage | _HeldVerdict] = {}
        self._serial = 0
        self.dropped_verdicts = 0

    @property
    def idle(self) -> bool:
        """Return whether the broker has everything that it could be given."""
        queued = self._waiting or self._unacknowledged or self._fleeting or self._repeats
        return not (self._online and queued)

    @property
    def repeating(self) -> bool:
        """Return whether some of what `again` asked for still waits."""
        return bool(self._repeats)

    def __len__(self) -> int:
        """Return how many messages are held in all."""
        queued = len(self._waiting) + len(self._fleeting) + len(self._unacknowledged)
        return len(self._retained) + queued

    def latest(self, topic: str) -> bytes | None:
        """Return what a retained topic holds as far as we know, or None."""
        message = self._retained.get(topic)
        return None if message is None else message.payload

    def put(self, message: OutMessage, now: float, *, at_end: bool = False) -> None:
        """Take one message. A retained value that the topic has already changes nothing.

        Args:
            message: What is to go out.
            now: Monotonic seconds.
            at_end: It goes behind all that waits, although its topic has a place: for a value that
                is only true after the others, such as `online`.
        """
        if message.retain:
            if self.latest(message.topic) != message.payload:
                self._retained[message.topic] = message
                self._wait_with(message, at_end=at_end)
        elif message.qos > 0:
            self._put_verdict(message, now)
        elif self._online:
            self._fleeting.append(message)

    def again(self, topics: Iterable[str]) -> None:
        """Send the latest value of these topics once more, in this order, beside what is new.

        A topic that waits to be repeated keeps its place.
        """
        if not self._online:
            return  # at connect everything goes out
        for topic in topics:
            if topic in self._retained:
                self._repeats.setdefault(topic)

    def repeat_now(self, topic: str) -> None:
        """Send the latest value of a topic once more, as if it were new."""
        message = self._retained.get(topic)
        if message is not None:
            self._wait_with(message, at_end=True)

    def _wait_with(self, message: OutMessage, *, at_end: bool) -> None:
        if self._online:
            self._waiting[message.topic] = message  # in its place, if it has one
            if at_end:
                self._waiting.move_to_end(message.topic)

    def forget(self, topics: Iterable[str]) -> None:
        """Hold no value for these topics any more. What is on its way is not called back."""
        for topic in topics:
            self._retained.pop(topic, None)
            self._waiting.pop(topic, None)
            self._repeats.pop(topic, None)

    def connected(self, order: Iterable[str], now: float) -> None:
        """Note that the broker is there: every retained value goes out, those of `order` last.

        Verdicts that were held follow.
        """
        self.disconnected(now)
        self._online = True
        last = [topic for topic in order if topic in self._retained]
        for topic in (*self._retained, *last):
            self._wait_with(self._retained[topic], at_end=True)
        for verdict in self._waiting_verdicts:
            self._waiting.move_to_end(verdict.serial)

    def disconnected(self, now: float) -> None:
        """Note that the broker is gone: what it did not acknowledge it may not have."""
        self._online = False
        self._fleeting.clear()
        self._repeats.clear()
        lost = (item for item in self._unacknowledged.values() if isinstance(item, _HeldVerdict))
        held = sorted((*lost, *self._waiting_verdicts), key=lambda verdict: verdict.serial)
        self._unacknowledged.clear()
        self._waiting = OrderedDict((verdict.serial, verdict) for verdict in held)
        self._waiting_verdicts = deque(held)
        self._waiting_bytes = sum(verdict.size for verdict in held)
        self._drop_verdicts(now)

    def acknowledged(self, token: int) -> None:
        """Note that the broker has the message that `send` gave this token."""
        item = self._unacknowledged.pop(token, None)
        if isinstance(item, OutMessage) and not item.payload:
            self._forget(item)

    def _forget(self, cleared: OutMessage) -> None:
        if self._retained.get(cleared.topic) is cleared:  # it has no newer value
            del self._retained[cleared.topic]
            self._repeats.pop(cleared.topic, None)

    def pump(self, send: Send, now: float) -> None:
        """Send what may go out now. `send` returns None while there is no connection."""
        self._drop_verdicts(now)
        while self._fleeting:
            send(self._fleeting.popleft())
        while self._has_room() and (item := self._next()) is not None:
            token = send(item.message if isinstance(item, _HeldVerdict) else item)
            if token is None:
                return  # the event that says so is on its way
            self._left(item)
            if isinstance(item, _HeldVerdict) or item.qos > 0:  # the broker acknowledges no other
                self._unacknowledged[token] = item

    def _has_room(self) -> bool:
        return self._online and len(self._unacknowledged) < self._window

    def _next(self) -> OutMessage | _HeldVerdict | None:
        self._turn += 1
        if not self._waiting or self._turn % _REPEAT_EACH == 0:
            # What has a new value goes in the order in which that came: `online` after states.
            while self._repeats and (topic := next(iter(self._repeats))) in self._waiting:
                del self._repeats[topic]
            if self._repeats:
                return self._retained[next(iter(self._repeats))]
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
