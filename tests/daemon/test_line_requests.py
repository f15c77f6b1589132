"""Requests for work on a line: who gets it, what is answered."""

import json
from typing import Any

import pytest
from support.fake_worker import FakeWorker
from support.links import prove
from support.mqtt_side import CONFIG, MAIN, FakeConnection

from bridge.config.current import CurrentConfig
from bridge.daemon.line_requests import ErrandDesk
from bridge.line.errand import EndErrand, Errand, ErrandTold
from bridge.mqtt.events import Received
from bridge.mqtt.link import LinkCheck
from bridge.mqtt.outbox import Outbox
from bridge.mqtt.requests import RequestDesk
from bridge.mqtt.topics import Topics


class World:
    """A desk, its line `main`, and a broker."""

    def __init__(self) -> None:
        self.now = 100.0
        self.outbox = Outbox()
        self.outbox.connected([], self.now)
        link = LinkCheck("run")
        prove(link, self.now)
        self.requests = RequestDesk(Topics("wisco"), self.outbox, link, self.clock)
        self.workers = {"main": FakeWorker(MAIN)}
        self.desk = ErrandDesk(
            CurrentConfig(CONFIG), self.workers, self.requests, lambda _: None, self.clock
        )
        self.desk.open()

    def clock(self) -> float:
        """The instant."""
        return self.now

    def ask(self, verb: str, **request: Any) -> list[tuple[int, dict[str, Any]]]:
        """Sends a request; gives the QoS and the content of each answer that goes out."""
        payload = json.dumps(request).encode()
        topic = f"wisco/bridge/request/{verb}"
        self.requests.take(verb, Received(topic, payload, False, self.now))
        return self.answers()

    def answers(self) -> list[tuple[int, dict[str, Any]]]:
        """What goes out now."""
        connection = FakeConnection()
        self.outbox.pump(connection.publish, self.now)
        return [(m.qos, json.loads(m.payload)) for m in connection.taken()]

    def errand(self) -> Errand:
        """The one that the line was given last."""
        errand = self.workers["main"].tasks[-1]
        assert isinstance(errand, Errand)
        return errand

    def tell(self, errand: Errand, data: dict[str, Any], **more: Any) -> list[Any]:
        """The line says something; gives what goes out."""
        self.desk.told(ErrandTold(errand.line, errand.id, data, **more))
        return self.answers()


@pytest.fixture
def world() -> World:
    """All of it."""
    return World()


def test_progress_is_told_once_a_second_and_the_end_at_once(world: World) -> None:
    """Progress may be lost, the end may not."""
    assert world.ask("scan", line="main", id="x") == []
    errand = world.errand()
    assert world.tell(errand, {"progress": 0.0}) == [
        (0, {"status": "ok", "data": {"progress": 0.0, "final": False}, "id": "x"})
    ]
    world.now += 0.9
    assert world.tell(errand, {"progress": 0.1}) == []
    world.now += 0.2
    [(_, answer)] = world.tell(errand, {"progress": 0.2})
    assert answer["data"]["progress"] == 0.2
    assert world.tell(errand, {"progress": 1.0}, ended=True) == [
        (1, {"status": "ok", "data": {"progress": 1.0, "final": True}, "id": "x"})
    ]


def test_what_an_earlier_errand_says_late_is_no_answer_to_the_next(world: World) -> None:
    """Each has a ticket of its own."""
    world.ask("scan", line="main", id=1)
    first = world.errand()
    assert len(world.tell(first, {}, ended=True, error="it broke off")) == 1
    world.ask("scan", line="main", id=2)
    assert world.tell(first, {"progress": 1.0}, ended=True) == []
    assert world.errand().id != first.id


def test_an_error_is_an_answer(world: World) -> None:
    """And the line is free again."""
    world.ask("eeprom", station="garage", id=1)
    assert world.tell(world.errand(), {}, ended=True, error="the port is gone") == [
        (1, {"status": "error", "data": {}, "error": "the port is gone", "id": 1})
    ]
    assert world.ask("scan", line="main", id=2) == []


def test_a_line_that_is_being_exchanged_takes_none(world: World) -> None:
    """Whoever asked is told to ask again."""
    del world.workers["main"]
    [(_, answer)] = world.ask("scan", line="main")
    assert answer["error"] == "line main is just being exchanged: ask again"


def test_one_errand_a_line(world: World) -> None:
    """The second is refused, and the line never hears of it."""
    world.ask("eeprom", station="garage")
    [(_, answer)] = world.ask("scan", line="main")
    assert answer["error"] == "line main is busy with another eeprom: wait for its end"
    assert len(world.workers["main"].tasks) == 1


def test_what_is_under_way_can_be_stopped(world: World) -> None:
    """By a request of the same kind; where nothing of it is under way that is said."""
    [(_, answer)] = world.ask("scan", line="main", stop=True)
    assert answer["error"] == "no scan is under way on line main"
    world.ask("scan", line="main", id="mine")
    errand = world.errand()
    [(_, answer)] = world.ask("eeprom", station="garage", stop=True)
    assert answer["error"] == "no eeprom is under way on line main"
    assert world.ask("scan", line="main", stop=True, id="stop") == [
        (1, {"status": "ok", "data": {"line": "main", "final": True}, "id": "stop"})
    ]
    assert world.workers["main"].tasks[-1] == EndErrand(errand.id)
    [(_, answer)] = world.tell(errand, {}, ended=True, error="it was stopped by a request")
    assert (answer["id"], answer["status"]) == ("mine", "error")
