"""Publishes what passes on a line, for a limited time, on request: `B/bridge/line/L/trace`."""

from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any

from bridge.config.current import CurrentConfig
from bridge.config.durations import parse_duration
from bridge.daemon.line_requests import line_of
from bridge.hub.line_set import Worker
from bridge.line.errand import Trace
from bridge.model import LinePassed
from bridge.mqtt.events import OutMessage
from bridge.mqtt.link import LinkCheck
from bridge.mqtt.outbox import Send
from bridge.mqtt.payloads import as_json
from bridge.mqtt.requests import BridgeRequest, RequestDesk, only
from bridge.mqtt.strict_json import bad
from bridge.mqtt.topics import Topics

if TYPE_CHECKING:
    from bridge.daemon.traced_line import TracedLine

MOST_A_SECOND = 200
ListenToTrace = Callable[[str, float, Mapping[str, Any]], None]
_LONGEST_S = 600.0
_DEFAULT = "60s"


class TraceDesk:
    """Handles `trace`. Only the main thread calls it.

    Without a trace a line does not report its bytes, so it costs nothing. The threads of lines call
    `tell`; it brings the bytes back to the main thread, to `passed`.

    Attributes:
        listen: Is told what is published, such as the panel in the browser.
    """

    def __init__(
        self,
        *,
        current: CurrentConfig,
        lines: Mapping[str, Worker],
        desk: RequestDesk,
        topics: Topics,
        link: LinkCheck,
        publish: Send,
        tell: Callable[[LinePassed], None],
        clock: Callable[[], float],
        wall_clock: Callable[[], datetime],
    ) -> None:
        self._current = current
        self._lines = lines
        self._desk = desk
        self._topics = topics
        self._link = link
        self._publish = publish
        self._tell = tell
        self._clock = clock
        self._wall_clock = wall_clock
        self._traced: dict[str, TracedLine] = {}
        self.listen: ListenToTrace | None = None

    def open(self) -> None:
        """Register its requests."""
        self._desk.serve("trace", self._trace)

    def passed(self, passed: LinePassed) -> None:
        """Publish what passed on a line."""
        traced = self._traced.get(passed.line)
        if traced is None:
            return
        for at, heard in traced.hear(passed):
            heard["dropped"] = traced.dropped
            told = self._send(passed.line, {"time": self._time(at), **heard})
            if self.listen is not None:
                self.listen(passed.line, at, heard)
                told = True
            traced.dropped = 0 if told else traced.dropped + 1

    def tick(self, now: float) -> None:
        """End traces that are over; continue others on lines that were exchanged or came back."""
        for line, traced in list(self._traced.items()):
            worker = self._lines.get(line)
            if now >= traced.until:
                del self._traced[line]
                if worker is not None:
                    worker.ask(Trace(None))
            elif worker is not None and worker is not traced.worker:
                traced.worker = worker
                worker.ask(Trace(self._tell))

    def _trace(self, request: BridgeRequest) -> Mapping[str, Any]:
        only(request, "line", "for")
        line = line_of(request, self._current.config)
        for_s = self.start(line.id, _span_s(request))
        return {
            "line": line.id,
            "for_s": round(for_s, 3),
            "topic": self._topics.line_trace(line.id),
            "most_a_second": MOST_A_SECOND,
        }

    def start(self, line: str, span_s: float) -> float:
        """Trace a line for a time; 0 ends it. Return for how long it is traced now."""
        now = self._clock()
        until = now + span_s
        traced = self._traced.setdefault(line, _traced(until))
        # A shorter request does not end the trace for another client; only 0 does.
        traced.until = max(traced.until, until) if span_s > 0 else now
        self.tick(now)
        return max(0.0, traced.until - now)

    def _time(self, at: float) -> str:
        time = self._wall_clock() - timedelta(seconds=self._clock() - at)
        return time.isoformat(timespec="microseconds")

    def _send(self, line: str, document: Mapping[str, Any]) -> bool:
        """Send past the outbox, because it is not worth keeping; return False if it was dropped."""
        if self._link.away(self._clock()):
            return False  # nothing is queued when the broker takes nothing
        topic = self._topics.line_trace(line)
        return self._publish(OutMessage(topic, as_json(document), qos=0, retain=False)) is not None


def _traced(until: float) -> "TracedLine":
    # The decoder takes half a megabyte, which a bridge without a trace does not need.
    from bridge.daemon.traced_line import TracedLine  # noqa: PLC0415

    return TracedLine(until, MOST_A_SECOND)


def _span_s(request: BridgeRequest) -> float:
    span = request.arguments.get("for", _DEFAULT)
    try:
        span_s = float(parse_duration(span))
    except (TypeError, ValueError):
        raise bad('for is a time, such as "60s"; "0" ends the trace') from None
    if span_s > _LONGEST_S:
        raise bad(f"for is at most {_LONGEST_S / 60:g}min: ask again before the end")
    return span_s
