"""The trace of a line of the running daemon, on request."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.line_house import LineHouse, line_house
from support.mqtt_probe import Seen
from support.panel import BASE

from bridge.daemon.trace import MOST_A_SECOND
from bridge.model import LineProtocol
from bridge.simulator.faults import FaultKind
from bridge.simulator.wire import Direction

TOPIC = f"{BASE}/bridge/line/main/trace"
ENOUGH = 40


@pytest.fixture
def house(tmp_path: Path) -> Iterator[LineHouse]:
    """A line of Modbus RTU at the pace of the wire."""
    with line_house(tmp_path, LineProtocol.MODBUS_RTU) as running:
        yield running


def traced(seen: list[Seen]) -> list[dict[str, Any]]:
    """Return the trace of the line."""
    return [json.loads(m.payload) for m in seen if m.topic == TOPIC]


def test_every_frame_is_told_with_its_meaning(house: LineHouse) -> None:
    """Just what the wire log of the modules has, in its order, and a command among it."""
    assert not traced(house.probe.seen)
    house.ask("trace", "t1", line="main", for_="60s")
    assert house.final("trace", "t1")["data"] == {
        "line": "main",
        "for_s": 60.0,
        "topic": TOPIC,
        "most_a_second": MOST_A_SECOND,
    }
    house.probe.wait_for(lambda seen: len(traced(seen)) >= ENOUGH)
    house.probe.publish(f"{BASE}/pumps/do/3/set", "ON")
    # One more than the request itself: by then the module's own log has it too.
    house.probe.wait_for(lambda seen: any(_switches_3(one) for one in traced(seen)[:-1]))
    told = traced(house.probe.seen)
    told = told[: [_switches_3(one) for one in told].index(True) + 2]
    assert {one["problem"] for one in told} == {None}
    assert {one["dropped"] for one in told} == {0}
    requests = [one["bytes"] for one in told if one["direction"] == "request"]
    assert _stand_together(requests, [frame.hex() for frame in house.sent()])
    replies = [one["bytes"] for one in told if one["direction"] == "reply"]
    said = [e.data.hex() for e in house.line.log if e.direction is Direction.TO_MASTER]
    assert "".join(replies) in "".join(said)
    assert all(one["reply_ms"] > 0 for one in told if one["direction"] == "reply")
    assert {one["station"] for one in told} == {1, 2}


def _switches_3(told: dict[str, Any]) -> bool:
    return told["direction"] == "request" and "3 ON" in told["meaning"]


def _stand_together(part: list[str], whole: list[str]) -> bool:
    ends = range(len(whole) - len(part) + 1)
    return any(whole[at : at + len(part)] == part for at in ends)


def test_what_is_wrong_is_told(house: LineHouse) -> None:
    """A reply that is lost."""
    house.ask("trace", "t1", line="main")
    house.probe.wait_for(lambda seen: bool(traced(seen)))
    house.line.faults.set(FaultKind.SILENT, address=1, times=1)
    house.probe.wait_for(lambda s: any(one["problem"] for one in traced(s)))
    problems = [one["problem"] for one in traced(house.probe.seen) if one["problem"]]
    assert problems == ["station 1 did not answer"]


def test_a_trace_goes_on_over_a_port_that_comes_back_and_a_reload(house: LineHouse) -> None:
    """A trace continues over a lost port and over a reload."""
    house.ask("trace", "t1", line="main", for_="10min")
    house.probe.wait_for(lambda seen: bool(traced(seen)))
    house.line.faults.set(FaultKind.HANG_UP, times=1, delay_s=0.1)
    house.probe.wait_message(f"{BASE}/bridge/line/main/availability", "offline")
    house.probe.clear()
    house.probe.wait_for(lambda seen: bool(traced(seen)))
    house.config.write_text(house.config.read_text().replace("id: pumps}", "id: tanks}"))
    house.ask("reload", "r1")
    house.final("reload", "r1")
    house.probe.clear()
    house.probe.wait_for(lambda seen: bool(traced(seen)))
