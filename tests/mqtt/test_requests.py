import json
import logging
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from support.world import World

from bridge.daemon.bridge_requests import log_level
from bridge.errors import CommandError
from bridge.mqtt.link import STALE_AFTER_S
from bridge.mqtt.requests import MOST_A_SECOND, BridgeRequest, only
from bridge.mqtt.strict_json import bad


class ServingDesk(World):
    """A desk on a virtual clock that serves three kinds of requests."""

    def __init__(self) -> None:
        super().__init__()
        self.come_up()
        self.later: list[BridgeRequest] = []
        self.desk.serve("echo", self._echo)
        self.desk.serve("later", self.later.append, fresh_only=True)
        self.desk.serve("fail", self._fail)

    @staticmethod
    def _echo(request: BridgeRequest) -> Mapping[str, Any]:
        return dict(request.arguments)

    @staticmethod
    def _fail(request: BridgeRequest) -> None:
        only(request, "good")
        raise bad("it is broken")

    def answers_to(self, verb: str, payload: bytes = b"", *, retain: bool = False) -> list[Any]:
        """Send a request, and return the answers that go out."""
        self.ask(verb, payload, retain=retain)
        return self.answers()

    def answers(self) -> list[Any]:
        """Return the answers that go out now, with the last level of their topics."""
        sent = []
        for message in self.pumped():
            assert (message.qos, message.retain) == (1, False)
            topic = message.topic.removeprefix("wisco/bridge/response/")
            sent.append((topic, json.loads(message.payload)))
        return sent


@pytest.fixture
def world() -> ServingDesk:
    """A desk that is open."""
    return ServingDesk()


@pytest.mark.parametrize(
    ("payload", "answer"),
    [
        (b'{"id": "x1", "level": 3}', {"data": {"level": 3}, "id": "x1"}),
        (b"", {"data": {}}),
        (b"{}", {"data": {}}),
        (b'{"transaction": 7}', {"data": {}, "id": 7}),
        (b'{"transaction": 7, "id": 8}', {"data": {}, "id": 8}),
    ],
)
def test_an_answer_at_once(world: ServingDesk, payload: bytes, answer: dict[str, Any]) -> None:
    """The status, what there is to say, and the sender's mark: `id`, else `transaction`."""
    assert world.answers_to("echo", payload) == [("echo", {"status": "ok", **answer})]


def test_the_panel_asks_without_the_broker(world: ServingDesk) -> None:
    """Progress, answers and refusals go to it; nothing is published, whatever the link is."""
    told: list[Mapping[str, Any]] = []
    world.desk.ask("echo", {"level": 3}, told.append)
    world.desk.ask("fail", {}, told.append)
    world.desk.ask("later", {}, told.append)
    world.desk.progress(world.later[0], {"final": False})
    world.desk.answer(world.later[0], {"final": True})
    assert told == [
        {"status": "ok", "data": {"level": 3}},
        {"status": "error", "data": {}, "error": "it is broken"},
        {"status": "ok", "data": {"final": False}},
        {"status": "ok", "data": {"final": True}},
    ]
    assert world.answers() == []


def test_an_answer_later(world: ServingDesk) -> None:
    """A request that takes time is answered once, when it is done."""
    assert world.answers_to("later", b'{"id": 1}') == []
    [request] = world.later
    world.desk.answer(request, {"kept": []})
    assert world.answers() == [("later", {"status": "ok", "data": {"kept": []}, "id": 1})]


def test_what_cannot_be_done_says_why(world: ServingDesk) -> None:
    """An error has a text, no data, and the mark."""
    assert world.answers_to("fail", b'{"id": 1}') == [
        ("fail", {"status": "error", "data": {}, "error": "it is broken", "id": 1})
    ]
    [(_, answer)] = world.answers_to("fail", b'{"bad": 1}')
    assert answer["error"] == "unknown key 'bad'"


@pytest.mark.parametrize("verb", ["scan", "eeprom", "restart", "Ä", "x" * 48])
def test_an_unknown_request_is_an_error(world: ServingDesk, verb: str) -> None:
    """An unknown request gets an error on its own topic, with the known ones."""
    [(topic, answer)] = world.answers_to(verb, b'{"id": "x"}')
    assert (topic, answer["status"], answer["id"]) == (verb, "error", "x")
    assert answer["error"] == "unknown request; there are echo, fail, later"


@pytest.mark.parametrize("verb", ["", "x" * 49])
def test_a_topic_of_no_bearable_length_is_passed_over(world: ServingDesk, verb: str) -> None:
    """No client waits for an answer there."""
    assert world.answers_to(verb) == []


@pytest.mark.parametrize(
    ("payload", "error"),
    [
        (b"ON", "not a JSON object"),
        (b"[1]", "not a JSON object"),
        (b"\xff", "not UTF-8"),
        (b"{" * 4096, "not a JSON object"),
        (b'{"a": "%s"}' % (b"x" * 4096), "4105 bytes"),
        (b'{"a": 1, "a": 2}', "key 'a' stands there twice"),
        (b'{"id": 1, "id": 2}', "key 'id' stands there twice"),
        (b'{"id": true}', "id is neither"),
        (b'{"id": ""}', "id has not 1 to 128"),
        (b'{"id": "%s"}' % (b"x" * 129), "id has not 1 to 128"),
        (b'{"transaction": 1.5}', "transaction is neither"),
        (b'{"id": "\\ud800"}', "id has no UTF-8 form"),
    ],
)
def test_a_bad_payload_is_an_error(world: ServingDesk, payload: bytes, error: str) -> None:
    """Any bad payload gets one answer, and nothing is done."""
    [(topic, answer)] = world.answers_to("later", payload)
    assert (topic, answer["status"]) == ("later", "error")
    assert answer["error"].startswith(error)
    assert world.later == []


def test_a_retained_request_is_refused(world: ServingDesk) -> None:
    """A retained request is refused, as it would be repeated at every start."""
    [(_, answer)] = world.answers_to("later", b'{"id": 1}', retain=True)
    assert answer["error"].startswith("retained")
    assert answer["id"] == 1
    assert world.later == []
    assert world.answers_to("later", b"", retain=True) == []  # somebody clears it


def test_a_request_that_was_long_under_way_is_refused_where_that_matters(
    world: ServingDesk,
) -> None:
    """Reading is harmless; what changes something must be fresh."""
    world.now = STALE_AFTER_S + 0.1
    [(_, answer)] = world.answers_to("later")
    assert answer["error"].startswith("stale_link")
    assert world.later == []
    [(_, answer)] = world.answers_to("echo")
    assert answer["status"] == "ok"


def test_a_flood_is_answered_and_not_served(world: ServingDesk) -> None:
    """In a flood ten requests a second are served, the others are refused."""
    answers = [world.answers_to("echo")[0][1]["status"] for _ in range(MOST_A_SECOND + 5)]
    assert answers == ["ok"] * MOST_A_SECOND + ["error"] * 5
    world.now += 1.0
    assert world.answers_to("echo")[0][1]["status"] == "ok"


# --- what is served ----------------------------------------------------------------------------


@pytest.fixture
def root() -> Iterator[logging.Logger]:
    """The root of all loggers, at the level info; as it was afterwards."""
    root = logging.getLogger()
    level = root.level
    root.setLevel(logging.INFO)
    yield root
    root.setLevel(level)


def test_the_log_level_is_told_and_set(root: logging.Logger) -> None:
    """Without a level nothing changes."""
    assert log_level(BridgeRequest("log_level", {})) == {"level": "info"}
    assert log_level(BridgeRequest("log_level", {"level": "debug"})) == {"level": "debug"}
    assert root.level == logging.DEBUG


@pytest.mark.parametrize(
    "arguments", [{"level": "loud"}, {"level": 10}, {"level": ["debug"]}, {"levle": "debug"}]
)
def test_another_level_is_an_error(root: logging.Logger, arguments: dict[str, Any]) -> None:
    """Only the levels of the command line are taken."""
    with pytest.raises(CommandError):
        log_level(BridgeRequest("log_level", arguments))
    assert root.level == logging.INFO
