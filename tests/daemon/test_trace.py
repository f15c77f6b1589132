"""Requests to be told what passes on a line: for how long, and how much of it."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import pytest
from support.fake_worker import FakeWorker
from support.links import prove
from support.mqtt_side import CONFIG, MAIN, FakeConnection

from bridge.config.current import CurrentConfig
from bridge.daemon.trace import MOST_A_SECOND, TraceDesk
from bridge.line.errand import Trace
from bridge.model import LinePassed
from bridge.mqtt.events import Received
from bridge.mqtt.link import STALE_AFTER_S, LinkCheck
from bridge.mqtt.outbox import Outbox
from bridge.mqtt.requests import RequestDesk
from bridge.mqtt.topics import Topics

ASK, REPLY = b"#01RDIH\r", b"DI>0004\r"


class World:
    """A desk, its line `main`, and a broker."""

    def __init__(self) -> None:
        self.now = 100.0
        self.connection = FakeConnection()
        self.link = LinkCheck("run")
        prove(self.link, self.now)
        outbox, topics = Outbox(), Topics("wisco")
        self.requests = RequestDesk(topics, outbox, self.link, self.clock)
        self.worker = FakeWorker(MAIN)
        self.workers: dict[str, FakeWorker] = {"main": self.worker}
        self.desk = TraceDesk(
            current=CurrentConfig(CONFIG),
            lines=self.workers,
            desk=self.requests,
            topics=topics,
            link=self.link,
            publish=self.connection.publish,
            tell=lambda _: None,
            clock=self.clock,
            wall_clock=lambda: datetime.fromtimestamp(1000.0 + self.now, UTC),
        )
        self.desk.open()

    def clock(self) -> float:
        """The instant."""
        return self.now

    def ask(self, **request: Any) -> None:
        """Sends a request."""
        payload = json.dumps({"line": "main", **request}).encode()
        self.requests.take("trace", Received("wisco/bridge/request/trace", payload, False, 0.0))

    def tick(self, seconds: float) -> None:
        """Time passes."""
        self.now += seconds
        self.desk.tick(self.now)

    def exchange(self) -> list[Mapping[str, Any]]:
        """A request and its reply pass; gives what is told of them."""
        for data, sent in ((ASK, True), (REPLY, False)):
            self.desk.passed(LinePassed("main", self.now, data, sent))
        return [json.loads(m.payload) for m in self.connection.taken()]

    def is_tapped(self) -> bool:
        """Whether the line was last told to tell what passes."""
        last = self.worker.tasks[-1]
        assert isinstance(last, Trace)
        return last.tell is not None


@pytest.fixture
def world() -> World:
    """All of it."""
    return World()


def test_a_trace_begins_and_ends(world: World) -> None:
    """The line hears of it twice: while nobody asks it does nothing."""
    world.tick(1.0)
    assert world.worker.tasks == []
    world.ask(**{"for": "3s"})
    world.tick(2.0)
    assert len(world.worker.tasks) == 1
    assert world.is_tapped()
    assert [one["meaning"] for one in world.exchange()] == ["read inputs", "inputs ON: 3"]
    world.tick(1.1)
    assert not world.is_tapped()
    assert world.exchange() == []


def test_who_asks_for_less_ends_it_for_nobody(world: World) -> None:
    """But for 0, which everybody means as he says it."""
    world.ask(**{"for": "60s"})
    world.ask(**{"for": "1s"})
    world.tick(50.0)
    assert world.is_tapped()
    world.ask(**{"for": "0"})
    assert not world.is_tapped()


def test_the_successor_of_a_line_is_asked_anew(world: World) -> None:
    """A reload exchanges the worker; in between there is none."""
    world.ask(**{"for": "60s"})
    del world.workers["main"]
    world.tick(1.0)
    successor = FakeWorker(MAIN)
    world.workers["main"] = successor
    world.tick(1.0)
    assert len(successor.tasks) == 1
    del world.workers["main"]
    world.tick(60.0)
    assert len(successor.tasks) == 1


def test_times_are_of_the_wall(world: World) -> None:
    """With their zone, to the microsecond; the rest counts from frame to frame."""
    world.ask()
    world.desk.passed(LinePassed("main", world.now - 0.5, ASK, sent=True))
    world.desk.passed(LinePassed("main", world.now - 0.475, REPLY, sent=False))
    asked, said = (json.loads(m.payload) for m in world.connection.taken())
    assert asked["time"] == "1970-01-01T00:18:19.500000+00:00"
    assert (asked["gap_ms"], asked["reply_ms"]) == (None, None)
    assert (said["gap_ms"], said["reply_ms"]) == (25.0, 25.0)
    assert (said["bytes"], said["station"]) == (REPLY.hex(), 1)


def test_what_is_too_much_is_left_out_and_counted(world: World) -> None:
    """So much a second, in whole exchanges; the next that is told says how many were not."""
    world.ask(**{"for": "60s"})
    first = [world.exchange() for _ in range(MOST_A_SECOND)]
    told = [len(pair) for pair in first]
    assert told == [2] * (MOST_A_SECOND // 2) + [0] * (MOST_A_SECOND // 2)
    world.tick(1.0)
    request, reply = world.exchange()
    assert (request["dropped"], reply["dropped"]) == (MOST_A_SECOND, 0)
    assert request["bytes"] == ASK.hex()


def test_nothing_piles_up_where_the_broker_takes_nothing(world: World) -> None:
    """It is counted, and told when the broker is there again."""
    world.ask(**{"for": "60s"})
    world.connection.up = False
    assert world.exchange() == []
    world.connection.up = True
    world.tick(STALE_AFTER_S + 1)  # no ping came back
    assert world.exchange() == []
    prove(world.link, world.now)
    assert world.exchange()[0]["dropped"] == 4
