"""A request of a command to the bridge, and the messages that it accepts as answers."""

import json
from collections.abc import Iterator
from typing import Any, cast

import pytest

from bridge.cli.through_broker import ask_bridge
from bridge.cli.through_broker.ask_bridge import Inquiry, answers
from bridge.errors import BridgeError
from bridge.mqtt.events import OutMessage, Received
from bridge.mqtt.topics import Topics

TOPICS = Topics("wisco")
RESPONSE = TOPICS.response("scan")


class FakeBroker:
    """Answers a request with what the test says; `{id}` stands for the mark."""

    def __init__(self, *payloads: dict[str, Any] | bytes) -> None:
        self.sent: list[OutMessage] = []
        self._payloads = payloads
        self._due: Iterator[Received] = iter(())

    def publish(self, message: OutMessage) -> None:
        """Takes the request."""
        self.sent.append(message)
        request_id = json.loads(message.payload).get("id")
        self._due = iter([_received(payload, request_id) for payload in self._payloads])

    def messages(self, _until: float) -> Iterator[Received]:
        """Return the messages that arrive."""
        return self._due


def _received(payload: dict[str, Any] | bytes, request_id: str) -> Received:
    if isinstance(payload, bytes):
        return Received(RESPONSE, payload, False, 0.0)
    return Received(RESPONSE, json.dumps({"id": request_id, **payload}).encode(), False, 0.0)


def ask(*payloads: dict[str, Any] | bytes) -> list[Any]:
    """Asks, and gives what the answers hold."""
    broker = FakeBroker(*payloads)
    inquiry = Inquiry(TOPICS, "scan", {"line": "main"})
    told = list(answers(cast("Any", broker), inquiry))
    (request,) = broker.sent
    assert request.topic == "wisco/bridge/request/scan"
    assert not request.retain
    return told


def ok(**data: object) -> dict[str, Any]:
    """An answer."""
    return {"status": "ok", "data": data}


def test_answers_up_to_the_final_one() -> None:
    """One that does not say is final."""
    told = ask(ok(n=1, final=False), ok(n=2, final=False), ok(n=3, final=True), ok(n=4))
    assert [one["n"] for one in told] == [1, 2, 3]
    assert ask(ok(n=1), ok(n=2)) == [{"n": 1}]


def test_what_is_not_for_us_is_passed_over() -> None:
    """Answers to others, and what is none at all."""
    assert ask({**ok(n=9), "id": "other"}, b"\xff", b"[]", b"3", ok(n=1)) == [{"n": 1}]


def test_an_error_is_said() -> None:
    """An error of the bridge is raised with the bridge's own words."""
    with pytest.raises(BridgeError, match="the bridge says: line main is busy"):
        ask({"status": "error", "data": {}, "error": "line main is busy"})


def test_ctrl_c_ends_the_work_of_the_bridge() -> None:
    """Ctrl-C asks the bridge to end its scan."""

    class Interrupted(FakeBroker):
        def messages(self, _until: float) -> Iterator[Received]:
            raise KeyboardInterrupt

    broker = Interrupted()
    inquiry = Inquiry(TOPICS, "scan", {"line": "main", "thorough": True})
    with pytest.raises(KeyboardInterrupt):
        next(answers(cast("Any", broker), inquiry))
    assert json.loads(broker.sent[-1].payload) == {"line": "main", "stop": True}


def test_silence_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an answer the request ends with an error and advice."""
    monkeypatch.setattr(ask_bridge, "_PATIENCE_S", 0.05)
    with pytest.raises(BridgeError, match=r"no answer in 0.05 s: does the bridge run"):
        ask()
