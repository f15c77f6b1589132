"""Requests for work on a line: who gets it, what is answered."""

import json
from typing import Any

import pytest
from support.fake_worker import FakeWorker
from support.mqtt_side import MAIN
from support.world import World

from bridge.daemon.line_requests import ErrandDesk
from bridge.line.errand import EndErrand, Errand, ErrandTold


class Errands(World):
    """A desk for errands, its line `main`, and a broker."""

    def __init__(self) -> None:
        super().__init__(now=100.0)
        self.come_up()
        self.workers = {"main": FakeWorker(MAIN)}
        self.errands = ErrandDesk(self.current, self.workers, self.desk, lambda _: None, self.clock)
        self.errands.open()

    def answers_to(self, verb: str, **request: Any) -> list[tuple[int, dict[str, Any]]]:
        """Send a request; return the QoS and the content of each answer that goes out."""
        self.ask(verb, json.dumps(request).encode())
        return self.answers()

    def answers(self) -> list[tuple[int, dict[str, Any]]]:
        """Return what goes out now."""
        return [(m.qos, json.loads(m.payload)) for m in self.pumped()]

    def errand(self) -> Errand:
        """The one that the line was given last."""
        errand = self.workers["main"].tasks[-1]
        assert isinstance(errand, Errand)
        return errand

    def tell(self, errand: Errand, data: dict[str, Any], **more: Any) -> list[Any]:
        """The line says something; gives what goes out."""
        self.errands.told(ErrandTold(errand.line, errand.id, data, **more))
        return self.answers()


@pytest.fixture
def world() -> Errands:
    """All of it."""
    return Errands()


def test_progress_is_told_once_a_second_and_the_end_at_once(world: Errands) -> None:
    """Progress may be lost, the end may not."""
    assert world.answers_to("scan", line="main", id="x") == []
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


def test_what_an_earlier_errand_says_late_is_no_answer_to_the_next(world: Errands) -> None:
    """Each has a ticket of its own."""
    world.answers_to("scan", line="main", id=1)
    first = world.errand()
    assert len(world.tell(first, {}, ended=True, error="it broke off")) == 1
    world.answers_to("scan", line="main", id=2)
    assert world.tell(first, {"progress": 1.0}, ended=True) == []
    assert world.errand().id != first.id


def test_an_error_is_an_answer(world: Errands) -> None:
    """And the line is free again."""
    world.answers_to("eeprom", station="garage", id=1)
    assert world.tell(world.errand(), {}, ended=True, error="the port is gone") == [
        (1, {"status": "error", "data": {}, "error": "the port is gone", "id": 1})
    ]
    assert world.answers_to("scan", line="main", id=2) == []


def test_a_line_that_is_being_exchanged_takes_none(world: Errands) -> None:
    """Whoever asked is told to ask again."""
    del world.workers["main"]
    [(_, answer)] = world.answers_to("scan", line="main")
    assert answer["error"] == "line main is just being exchanged: ask again"


def test_one_errand_a_line(world: Errands) -> None:
    """The second is refused, and the line never hears of it."""
    world.answers_to("eeprom", station="garage")
    [(_, answer)] = world.answers_to("scan", line="main")
    assert answer["error"] == "line main is busy with another eeprom: wait for its end"
    assert len(world.workers["main"].tasks) == 1


def test_what_is_under_way_can_be_stopped(world: Errands) -> None:
    """By a request of the same kind; where nothing of it is under way that is said."""
    [(_, answer)] = world.answers_to("scan", line="main", stop=True)
    assert answer["error"] == "no scan is under way on line main"
    world.answers_to("scan", line="main", id="mine")
    errand = world.errand()
    [(_, answer)] = world.answers_to("eeprom", station="garage", stop=True)
    assert answer["error"] == "no eeprom is under way on line main"
    assert world.answers_to("scan", line="main", stop=True, id="stop") == [
        (1, {"status": "ok", "data": {"line": "main", "final": True}, "id": "stop"})
    ]
    assert world.workers["main"].tasks[-1] == EndErrand(errand.id)
    [(_, answer)] = world.tell(errand, {}, ended=True, error="it was stopped by a request")
    assert (answer["id"], answer["status"]) == ("mine", "error")


def test_verify_is_an_errand(world: Errands) -> None:
    """It goes to its line, and tells how far it is."""
    assert world.answers_to("verify", line="main", samples=20, id="v") == []
    assert world.tell(world.errand(), {"progress": 0.1})[0][1]["data"]["progress"] == 0.1


@pytest.mark.parametrize(
    ("verb", "request_", "error"),
    [
        ("scan", {"line": "loft"}, "line is to name one of main"),
        ("scan", {}, "line is to name one of main"),
        ("scan", {"line": "main", "stations": "40"}, "'40' is no station or range"),
        ("scan", {"line": "main", "stations": [1]}, 'such as "1-8,12"'),
        ("scan", {"line": "main", "thorough": 1}, "neither true nor false"),
        ("scan", {"line": "main", "baud": 4800}, "unknown key 'baud'"),
        ("eeprom", {"station": "loft"}, "one of the configuration"),
        ("eeprom", {"station": "garage", "action": "write"}, "unknown key 'action'"),
        ("verify", {"line": "cellar"}, "line is to name one of"),
        ("verify", {"line": "main", "samples": 3}, "samples is a number from 20 to 10000"),
        ("verify", {"line": "main", "samples": True}, "samples is a number from 20 to 10000"),
        ("verify", {"line": "main", "stations": "31"}, "has none of these stations"),
        ("verify", {"line": "main", "output": 2}, "output"),  # through the bridge it reads alone
    ],
)
def test_a_request_that_makes_no_sense_is_refused(
    world: Errands, verb: str, request_: dict[str, Any], error: str
) -> None:
    """The answer says in words what is wrong, and nothing is asked of the line."""
    [(_, answer)] = world.answers_to(verb, **request_)
    assert (answer["status"], answer["data"]) == ("error", {})
    assert error in answer["error"]
    assert world.workers["main"].tasks == []


@pytest.mark.parametrize("verb", ["scan", "eeprom"])
def test_a_retained_request_is_refused(world: Errands, verb: str) -> None:
    """It would be carried out at each start."""
    world.ask(verb, b'{"line": "main", "station": "garage"}', retain=True)
    [(_, answer)] = world.answers()
    assert "retained" in answer["error"]
    assert world.workers["main"].tasks == []
