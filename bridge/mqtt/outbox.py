"""What is to go out, bounded whatever fails (FAILURES.md B6). Time is an argument."""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from bridge.mqtt.events import OutMessage

WINDOW = 64
MOST_HELD = 256
HOLD_S = 60.0
# Connected, verdicts wait only until the broker has taken those before: a flood of commands is
# answered in full, since each command gets its verdict (CONTRACT.md, promise 3).
MOST_WAITING = 16_384
_MOST_FLEETING = 64

Send = Callable[[OutMessage], int | None]


@dataclass(frozen=True, slots=True)
class _Verdict:
    serial: int
    message: OutMessage
    since: float


class Outbox:
    """The latest value of each retained topic, and the queue to the broker.

    Retained values are kept for ever and go out again at each connect; a newer value takes the
    place of one that still waits, at the end. Verdicts (QoS 1, not retained) are held while the
    broker is away, 256 and 60 s at the most. QoS 0 that is not retained is for what nobody
    misses: it goes out now or never. At most a window of messages is with the broker
    unacknowledged; one with QoS 0 never is.

    Attributes:
        dropped_verdicts: How many verdicts nobody ever got.
    """

    def __init__(self, window: int = WINDOW) -> None:
        self._window = window
        self._online = False
        self._retained: dict[str, OutMessage] = {}
        self._waiting: OrderedDict[str | int, OutMessage | _Verdict] = OrderedDict()
        self._waiting_verdicts: deque[_Verdict] = deque()  # the same, in the same order
        self._fleeting: deque[OutMessage] = deque(maxlen=_MOST_FLEETING)
        self._unacknowledged: dict[int, OutMessage | _Verdict] = {}
        self._serial = 0
        self.dropped_verdicts = 0

    @property
    def idle(self) -> bool:
        """Whether the broker has everything that it could be given."""
        return not self._online or not (self._waiting or self._unacknowledged or self._fleeting)

    def __len__(self) -> int:
        """How many messages are held in all."""
        queued = len(self._waiting) + len(self._fleeting) + len(self._unacknowledged)
        return len(self._retained) + queued

    def latest(self, topic: str) -> bytes | None:
        """What a retained topic holds as far as we know, or None."""
        message = self._retained.get(topic)
        return None if message is None else message.payload

    def put(self, message: OutMessage, now: float) -> None:
        """Takes one message. A retained value that the topic has already changes nothing."""
        if message.retain:
            if self.latest(message.topic) != message.payload:
                self._retained[message.topic] = message
                self.again([message.topic])
        elif message.qos > 0:
            self._put_verdict(message, now)
        elif self._online:
            self._fleeting.append(message)

    def again(self, topics: Iterable[str]) -> None:
        """Sends the latest value of these topics once more, in this order."""
        if not self._online:
            return  # at connect everything goes out
        for topic in topics:
            if topic in self._retained:
                self._waiting[topic] = self._retained[topic]
                self._waiting.move_to_end(topic)

    def forget(self, topics: Iterable[str]) -> None:
        """Holds no value for these topics any more. What is on its way is not called back."""
        for topic in topics:
            self._retained.pop(topic, None)
            self._waiting.pop(topic, None)

    def connected(self, order: Iterable[str], now: float) -> None:
        """The broker is there: every retained value goes out, those of `order` last.

        Verdicts that were held follow.
        """
        self.disconnected(now)
        self._online = True
        self.again(list(self._retained))
        self.again(order)
        for verdict in self._waiting_verdicts:
            self._waiting.move_to_end(verdict.serial)

    def disconnected(self, now: float) -> None:
        """The broker is gone: what it did not acknowledge it may not have."""
        self._online = False
        self._fleeting.clear()
        lost = (item for item in self._unacknowledged.values() if isinstance(item, _Verdict))
        held = sorted((*lost, *self._waiting_verdicts), key=lambda verdict: verdict.serial)
        self._unacknowledged.clear()
        self._waiting = OrderedDict((verdict.serial, verdict) for verdict in held)
        self._waiting_verdicts = deque(held)
        self._drop_verdicts(now)

    def acknowledged(self, token: int) -> None:
        """The broker has the message that `send` gave this token."""
        item = self._unacknowledged.pop(token, None)
        if isinstance(item, OutMessage) and not item.payload:
            self._forget(item)

    def _forget(self, cleared: OutMessage) -> None:
        if self._retained.get(cleared.topic) is cleared:  # it has no newer value
            del self._retained[cleared.topic]

    def pump(self, send: Send, now: float) -> None:
        """Sends what may go out now. `send` returns None while there is no connection."""
        self._drop_verdicts(now)
        while self._fleeting:
            send(self._fleeting.popleft())
        for key in self._sendable():
            item = self._waiting[key]
            token = send(item.message if isinstance(item, _Verdict) else item)
            if token is None:
                return  # the event that says so is on its way
            del self._waiting[key]
            if isinstance(item, _Verdict):
                self._waiting_verdicts.popleft()
            elif item.qos == 0:
                continue  # the broker acknowledges none of these
            self._unacknowledged[token] = item

    def _sendable(self) -> Iterator[str | int]:
        while self._online and self._waiting and len(self._unacknowledged) < self._window:
            yield next(iter(self._waiting))

    def _put_verdict(self, message: OutMessage, now: float) -> None:
        self._serial += 1
        verdict = _Verdict(self._serial, message, now)
        self._waiting[verdict.serial] = verdict
        self._waiting_verdicts.append(verdict)
        self._drop_verdicts(now)

    def _drop_verdicts(self, now: float) -> None:
        most = MOST_WAITING if self._online else MOST_HELD
        waiting = self._waiting_verdicts
        while waiting and (len(waiting) > most or now - waiting[0].since > HOLD_S):
            del self._waiting[waiting.popleft().serial]
            self.dropped_verdicts += 1
