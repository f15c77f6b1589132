"""`make scans`: the scan of a whole line that a daemon owns, in real time, while it is at work.

Three modules at 9600 baud, one of them not configured; every address is asked, while
commands are sent and inputs are polled. A minute each.
"""

import json
import time
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from support.line_house import STRANGER, LineHouse, answers, line_house
from support.mqtt_probe import Seen
from support.panel import BASE, results

from bridge.model import LineProtocol
from bridge.simulator.wire import Direction

pytestmark = pytest.mark.timeout(300)

BETWEEN_COMMANDS_S = 0.37  # no whole part of anything on the line
FIRST_POLLS_S = 5.0


def polls(house: LineHouse, since: float) -> list[float]:
    """Return the times between two polls of station 1, in milliseconds."""
    head = {LineProtocol.WISCO: b"#01", LineProtocol.MODBUS_ASCII: b":01"}
    begin = head.get(house.line.protocol, b"\x01")
    asked = [
        entry.at
        for entry in house.line.log
        if entry.direction is Direction.TO_MODULES
        and entry.at >= since
        and entry.data.startswith(begin)
    ]
    return sorted(1000 * (later - at) for at, later in pairwise(asked))


def has_verdict(request_id: str, seen: list[Seen]) -> bool:
    """Return whether that command has its verdict."""
    return any(verdict.get("id") == request_id for verdict in results(seen))


def has_ended(seen: list[Seen]) -> bool:
    """Return whether the scan has its final answer."""
    told = answers(seen, "scan", "s1")
    return bool(told) and bool(told[-1]["data"].get("final", True))


def command(house: LineHouse, number: int) -> None:
    """Switches an output, and waits for the verdict."""
    request_id = f"c{number}"
    wish = json.dumps({"state": "ON" if number % 2 else "OFF", "id": request_id})
    house.probe.publish(f"{BASE}/pumps/do/1/set", wish)
    house.probe.wait_for(partial(has_verdict, request_id))


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_a_whole_line_is_scanned_while_it_works(
    protocol: LineProtocol, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All are found, each command is done in time, and besides them not a frame writes."""
    with line_house(tmp_path, protocol) as house:
        began = time.monotonic()
        time.sleep(FIRST_POLLS_S)  # a line without a scan, to compare with
        before = polls(house, began)
        began, number = time.monotonic(), 0
        house.ask("scan", "s1", line="main")
        while not has_ended(house.probe.seen):
            number += 1
            command(house, number)
            time.sleep(BETWEEN_COMMANDS_S)
        took_s = time.monotonic() - began
        data = house.final("scan", "s1")["data"]
        during = polls(house, began)
        verdicts = results(house.probe.seen)
        late = sorted(int(str(verdict["ms"])) for verdict in verdicts)
        with capsys.disabled():
            print(
                f"\n{protocol}: {took_s:.1f} s; {number} commands meanwhile, "
                f"median {late[len(late) // 2]} ms, at the most {late[-1]} ms; "
                f"{len(house.writes())} frames that write; ms between polls of station 1: "
                f"median {before[len(before) // 2]:.0f}, at the most {before[-1]:.0f} without a "
                f"scan; {during[len(during) // 2]:.0f}, {during[-1]:.0f} with it"
            )
        assert {one["address"]: one["id"] for one in data["found"]} == {
            1: "garage",
            2: "pumps",
            STRANGER: None,
        }
        assert {verdict["status"] for verdict in verdicts} == {"done"}
        assert len(house.writes()) == number
