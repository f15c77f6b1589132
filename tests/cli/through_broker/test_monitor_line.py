"""`monitor --line` shows the messages of a trace of the bridge."""

import json
import time
from collections.abc import Iterator
from typing import Any, cast

import pytest

from bridge.cli.through_broker import monitor_line
from bridge.commission.line_statistics import HeardStatistics
from bridge.errors import BridgeError
from bridge.mqtt.events import OutMessage, Received
from bridge.mqtt.topics import Topics
from bridge.protocol.passive.listener import Heard

TOPICS = Topics("wisco")
TRACE = TOPICS.line_trace("main")
FRAME = {
    "time": "2024-05-01T12:00:00.250000+07:00", "gap_ms": 11.8, "direction": "reply",
    "protocol": "modbus-rtu", "station": 1, "bytes": "0102020400bb78", "meaning": "inputs ON: 3",
    "problem": None, "reply_ms": 13.5, "dropped": 0,
}  # fmt: skip


class FakeBroker:
    """Brings what the test says, once, each time that it is asked."""

    def __init__(self, *messages: tuple[str, bytes]) -> None:
        self.sent: list[dict[str, Any]] = []
        self._messages = messages

    def publish(self, message: OutMessage) -> None:
        """Takes a request."""
        self.sent.append(json.loads(message.payload))

    def messages(self, until: float) -> Iterator[Received]:
        """Return the messages that arrive until an instant."""
        for topic, payload in self._messages:
            mark = str(self.sent[-1]["id"]).encode()
            yield Received(topic, payload.replace(b"MARK", mark), False, 0.0)
        time.sleep(max(0.0, until - time.monotonic()))


def feed(
    *messages: tuple[str, bytes], span_s: float = 0.05
) -> tuple[list[Heard], "FakeBroker", str | None]:
    """Listens for so long; gives what was heard, the broker, and what is said in the end."""
    broker, source = FakeBroker(*messages), monitor_line.Feed(TOPICS, "main")
    heard = list(source.heard(cast("Any", broker), time.monotonic() + span_s, lambda: False))
    statistics = HeardStatistics()
    for one in heard:
        statistics.count(one)
    return heard, broker, source.advice(statistics)


def frame(**change: Any) -> tuple[str, bytes]:
    """A frame as the bridge tells it."""
    return TRACE, json.dumps({**FRAME, **change}).encode()


def test_frames_are_as_the_bridge_heard_them() -> None:
    """By its own clock."""
    [heard], broker, advice = feed(frame())
    assert (heard.address, heard.meaning, heard.reply_s) == (1, "inputs ON: 3", 0.0135)
    assert heard.at % 1 == 0.25
    assert broker.sent[0]["line"] == "main"
    assert advice is None


def test_a_trace_is_asked_for_again_before_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """A trace is requested again before it ends, and not after the end of the command."""
    monkeypatch.setattr(monitor_line, "_RENEW_S", 0.01)
    monkeypatch.setattr(monitor_line, "_LOOK_S", 0.01)
    heard, broker, _ = feed(frame(), span_s=0.2)
    assert len(broker.sent) == len(heard) > 2
    assert len({request["id"] for request in broker.sent}) == 1


def test_what_was_not_told_is_said() -> None:
    """All of it together."""
    _, _, advice = feed(frame(dropped=3), frame(dropped=4))
    assert advice is not None
    assert advice.startswith("7 more passed")


def test_what_is_no_frame_is_named_and_passed_over(capsys: pytest.CaptureFixture[str]) -> None:
    """A message that is no trace is reported and skipped: any client may write to a topic."""
    heard, _, _ = feed((TRACE, b"\xff"), (TRACE, b"[]"), frame(time="noon"), frame())
    assert len(heard) == 1
    assert capsys.readouterr().err.count("not what a bridge publishes there") == 3


def test_silence_is_explained() -> None:
    """An empty trace is explained: nothing passed, or no bridge answers."""
    answer = json.dumps({"status": "ok", "data": {"line": "main"}, "id": "MARK"}).encode()
    _, _, advice = feed((TOPICS.response("trace"), answer))
    assert advice == "nothing passed: is the port of the line there?"
    _, _, advice = feed()
    assert advice == "the bridge did not answer: does it run, at this broker?"


def test_a_bridge_that_says_no_ends_it() -> None:
    """In its own words."""
    answer = json.dumps({"status": "error", "error": "line is to name one", "id": "MARK"}).encode()
    with pytest.raises(BridgeError, match="the bridge says: line is to name one"):
        feed((TOPICS.response("trace"), answer))
