"""`monitor --line`: shows the frames on a line of the running bridge, through the broker."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path

from bridge.cli.through_broker.ask_bridge import Inquiry, line_named, subscriptions
from bridge.cli.through_broker.broker import TIMEOUT_S, Broker, at_broker
from bridge.commission.line_statistics import HeardStatistics
from bridge.config.load import find_config, load_config
from bridge.mqtt.events import Subscription
from bridge.mqtt.topics import Topics
from bridge.protocol.passive.heard_document import read_heard
from bridge.protocol.passive.listener import Heard

_VERB = "trace"
# The trace is requested again and again, so that it ends by itself after our end.
_LEASE = "30s"
_RENEW_S = 10.0
_LOOK_S = 0.1


@dataclass(frozen=True, slots=True)
class MonitorSource:
    """The source of a monitor.

    Attributes:
        epoch_s: The offset from its instants to seconds since 1970.
        heard: Returns what passes, until the function that it takes returns True.
        advice: Returns a remark on the counts at the end; None: no remark.
    """

    port: str
    baud: int
    epoch_s: float
    heard: Callable[[Callable[[], bool]], Iterator[Heard]]
    advice: Callable[[HeardStatistics], str | None]


@contextmanager
def traced_line(name: str, config: Path | None, span_s: float | None) -> Iterator[MonitorSource]:
    """Listen at the broker within the block, for `span_s` seconds if given.

    Raises:
        UsageError: There is no such line.
        BridgeError: There is no broker or no bridge, or the bridge refuses.
    """
    loaded = load_config(find_config(config), os.environ)
    line = line_named(loaded, name)
    topics = Topics(loaded.mqtt.base_topic)
    feed = Feed(topics, line.id)
    wanted = (*subscriptions(topics, _VERB), Subscription(feed.topic))
    with at_broker(loaded.mqtt, "monitor", wanted, TIMEOUT_S) as broker:
        until = float("inf") if span_s is None else time.monotonic() + span_s
        heard = partial(feed.heard, broker, until)
        yield MonitorSource(line.port, line.baud, 0.0, heard, feed.advice)


class Feed:
    """The trace of one line.

    Attributes:
        topic: Its topic.
    """

    def __init__(self, topics: Topics, line: str) -> None:
        self.topic = topics.line_trace(line)
        self._inquiry = Inquiry(topics, _VERB, {"line": line, "for": _LEASE})
        self._answered = False
        self._dropped = 0

    def heard(self, broker: Broker, until: float, stopped: Callable[[], bool]) -> Iterator[Heard]:
        """Yield the pieces, and request the trace again before it ends."""
        renew_at = 0.0
        while not stopped() and (now := time.monotonic()) < until:
            if now >= renew_at:
                self._inquiry.send(broker)
                renew_at = now + _RENEW_S
            for message in broker.messages(min(until, now + _LOOK_S)):
                if message.topic == self.topic:
                    yield from self._read(message.payload)
                else:
                    self._answered |= self._inquiry.answer_in(message) is not None

    def advice(self, statistics: HeardStatistics) -> str | None:
        """Return a remark on pieces that were not sent, or on why there are none."""
        if self._dropped:
            return f"{self._dropped} more passed, and were not told: it was too much at once"
        if statistics.frames:
            return None
        if self._answered:
            return "nothing passed: is the port of the line there?"
        return "the bridge did not answer: does it run, at this broker?"

    def _read(self, payload: bytes) -> Iterator[Heard]:
        try:
            document = json.loads(payload)
            at = datetime.fromisoformat(document["time"]).timestamp()
            dropped = int(document["dropped"])
            heard = read_heard(document, at)
        except (KeyError, TypeError, ValueError) as error:
            print(f"{self.topic}: not what a bridge publishes there: {error}", file=sys.stderr)
            return
        self._dropped += dropped
        yield heard
