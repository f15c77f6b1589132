"""Errands of the daemon on its own line: a scan, and the dump of an EEPROM."""

import json
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from support.line_house import STRANGER, LineHouse, line_house
from support.mqtt_probe import Seen
from support.panel import BASE, results

from bridge.commission.image import parse_image
from bridge.model import DIO100, DO100, LineProtocol
from bridge.protocol.wisco_eeprom import EEPROM_BYTES
from bridge.simulator.faults import FaultKind
from bridge.simulator.module import SimulatedModule

COMMANDS = 5


@pytest.fixture
def house(tmp_path: Path) -> Iterator[LineHouse]:
    """A Wisco line at the pace of the wire."""
    with line_house(tmp_path, LineProtocol.WISCO) as running:
        yield running


def verdict_of(mark: str, seen: list[Seen]) -> bool:
    """Return whether that command has its verdict."""
    return any(verdict.get("id") == mark for verdict in results(seen))


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_a_scan_finds_who_is_there_and_writes_nothing(
    protocol: LineProtocol, tmp_path: Path
) -> None:
    """A scan finds also modules that are not configured, writes nothing, and reads go on."""
    with line_house(tmp_path, protocol) as house:
        house.ask("scan", "s1", line="main", stations="0-3,9")
        first = house.under_way("scan", "s1")["data"]
        assert (first["line"], first["progress"], first["found"]) == ("main", 0.0, [])
        house.line.module(1).toggle_input(3)
        house.probe.wait_message(f"{BASE}/garage/di/3", "ON")
        assert house.answers("scan", "s1")[-1]["data"]["final"] is False
        data = house.final("scan", "s1")["data"]
        assert house.writes() == []
        assert [(one["address"], one["model"], one["id"]) for one in data["found"]] == [
            (1, "DIO100", "garage"),
            (2, "DO100", "pumps"),
            (STRANGER, "DO100", None),
        ]
        assert (data["progress"], data["clashes"], data["noise"]) == (1.0, [], [])
        progress = [answer["data"]["progress"] for answer in house.answers("scan", "s1")]
        assert progress == sorted(progress)
        assert len(progress) > 2
        # Nobody went offline, nobody raised an alarm over what the scan heard.
        assert not [m for m in house.probe.seen if m.payload == b"offline"]
        assert "not requested" not in house.daemon.log


def test_commands_keep_their_priority(house: LineHouse) -> None:
    """Commands during a scan are carried out in time."""
    house.ask("scan", "s1", line="main", stations="3-6")
    house.under_way("scan", "s1")
    for number in range(1, COMMANDS + 1):
        mark = f"c{number}"
        wish = json.dumps({"state": "ON", "id": mark})
        house.probe.publish(f"{BASE}/pumps/do/{number}/set", wish)
        house.probe.wait_for(partial(verdict_of, mark))
    assert house.answers("scan", "s1")[-1]["data"]["final"] is False
    house.final("scan", "s1")
    verdicts = results(house.probe.seen)
    print("ms of commands during a scan:", [verdict["ms"] for verdict in verdicts])
    assert [verdict["status"] for verdict in verdicts] == ["done"] * COMMANDS
    assert house.line.module(2).outputs == 2**COMMANDS - 1


def test_polls_keep_most_of_the_line(house: LineHouse) -> None:
    """While no other module answers, the scan has a quarter of the time and no more."""
    before = len(house.sent())
    house.ask("scan", "s1", line="main", stations="10-13")
    house.final("scan", "s1")
    sent = house.sent()[before:]
    asked = [frame for frame in sent if frame[1:3] not in {b"01", b"02"}]
    assert len(asked) == 4
    # A silent station costs 0.42 s with the late window, a poll 0.02 s: 3 x 0.42 / 0.02 polls.
    polls_each = (len(sent) - len(asked)) / len(asked)
    print(f"{polls_each:.0f} polls for each station that was asked in vain")
    assert polls_each > 20


def test_a_clash_is_named_and_disturbs_nobody(house: LineHouse) -> None:
    """Two strangers with one address: found out between polls of modules that are well."""
    house.line.modules[101] = SimulatedModule(DO100, STRANGER)
    house.line.modules[101].set_output(1, True)
    house.ask("scan", "s1", line="main", stations=f"{STRANGER}")
    data = house.final("scan", "s1")["data"]
    assert [clash["address"] for clash in data["clashes"]] == [STRANGER]
    assert data["found"] == []
    assert not [m for m in house.probe.seen if m.payload == b"offline"]


def test_one_at_a_time(house: LineHouse) -> None:
    """A second errand is refused, and says what is under way; the first goes on."""
    house.ask("scan", "s1", line="main", stations="3-5")
    house.under_way("scan", "s1")
    assert "line main is busy with another scan" in house.refusal("scan", "s2", line="main")
    assert "busy with another scan" in house.refusal("eeprom", "e1", station="garage")
    assert house.final("scan", "s1")["status"] == "ok"


def test_requests_that_make_no_sense_are_refused(house: LineHouse) -> None:
    """In words, and nothing is asked of the line."""
    assert "line is to name one of main" in house.refusal("scan", "1", line="loft")
    assert "line is to name one of main" in house.refusal("scan", "2")
    assert "'40' is no station or range" in house.refusal("scan", "3", line="main", stations="40")
    assert 'such as "1-8,12"' in house.refusal("scan", "4", line="main", stations=[1])
    assert "neither true nor false" in house.refusal("scan", "5", line="main", thorough=1)
    assert "unknown key 'baud'" in house.refusal("scan", "6", line="main", baud=4800)
    assert "one of the configuration" in house.refusal("eeprom", "7", station="loft")
    assert "unknown key 'action'" in house.refusal("eeprom", "8", station="garage", action="write")
    house.probe.publish(f"{BASE}/bridge/request/scan", '{"line":"main","id":"r"}', retain=True)
    assert "retained" in house.final("scan", "r")["error"]
    house.probe.publish(f"{BASE}/bridge/request/scan", "", retain=True)
    assert not [frame for frame in house.sent() if frame[1:3] not in {b"01", b"02"}]


def test_a_reload_ends_a_scan_of_its_line(house: LineHouse) -> None:
    """With an answer; on the line as it is now a new one can be made."""
    house.ask("scan", "s1", line="main", thorough=True)
    house.under_way("scan", "s1")
    text = house.config.read_text()
    house.config.write_text(text.replace("id: pumps}", "id: pumps, name: Cellar}"))
    house.daemon.signal(signal.SIGHUP)
    answer = house.final("scan", "s1")
    assert answer["error"] == "line main is being stopped"
    house.daemon.wait_for_log("the configuration changed")
    house.ask("scan", "s2", line="main", stations="1")
    assert [one["id"] for one in house.final("scan", "s2")["data"]["found"]] == ["garage"]


def test_a_stop_ends_a_scan_with_an_answer(house: LineHouse) -> None:
    """A stop ends a scan after its present exchange, with an answer; the daemon ends normally."""
    house.ask("scan", "s1", line="main", thorough=True)
    house.under_way("scan", "s1")
    status, _ = house.daemon.stop()
    assert status == 0
    assert house.final("scan", "s1")["error"] == "line main is being stopped"
    house.probe.wait_message(f"{BASE}/bridge/state", "offline")


def test_a_port_that_goes_away_ends_a_scan(house: LineHouse) -> None:
    """With an answer that names it; the line comes back by itself."""
    house.ask("scan", "s1", line="main", thorough=True)
    house.under_way("scan", "s1")
    house.line.faults.set(FaultKind.HANG_UP, times=1, delay_s=2.0)
    answer = house.final("scan", "s1")
    assert answer["status"] == "error"
    assert str(house.line.port) in answer["error"]
    assert "has no port" in house.refusal("scan", "s2", line="main")
    house.probe.wait_for(_is_online_again)
    house.ask("scan", "s3", line="main", stations="2")
    assert house.final("scan", "s3")["status"] == "ok"


def _is_online_again(seen: list[Seen]) -> bool:
    latest = {m.topic: m.text for m in seen if m.topic.endswith("availability")}
    return set(latest.values()) == {"online"} and b"offline" in {m.payload for m in seen}


@pytest.mark.parametrize("protocol", [LineProtocol.WISCO, LineProtocol.MODBUS_ASCII])
def test_a_dump_is_the_whole_eeprom(protocol: LineProtocol, tmp_path: Path) -> None:
    """All 2,048 bytes, as Intel HEX with their model, between polls; nothing is written."""
    with line_house(tmp_path, protocol, paced=False) as house:
        house.ask("eeprom", "e1", station="garage")
        house.under_way("eeprom", "e1")
        house.line.module(1).toggle_input(3)
        house.probe.wait_message(f"{BASE}/garage/di/3", "ON")
        data = house.final("eeprom", "e1")["data"]
        image = parse_image(data["image"])
        there = house.line.module(1).read_eeprom(0, EEPROM_BYTES)
        assert bytes(image.content[at] for at in range(EEPROM_BYTES)) == there
        assert image.model == DIO100
        assert (data["station"], data["progress"]) == ("garage", 1.0)
        assert house.writes() == []


def test_a_modbus_rtu_line_has_no_way_to_an_eeprom(tmp_path: Path) -> None:
    """On a Modbus RTU line a request for an EEPROM is refused at once."""
    with line_house(tmp_path, LineProtocol.MODBUS_RTU, paced=False) as house:
        assert "Wisco frames alone" in house.refusal("eeprom", "e1", station="garage")


def test_a_module_that_is_silent_ends_a_dump(house: LineHouse) -> None:
    """With the module's name in the answer."""
    house.line.module(2).away = True
    house.probe.wait_message(f"{BASE}/pumps/availability", "offline")
    house.ask("eeprom", "e1", station="pumps")
    answer = house.final("eeprom", "e1")
    assert "station 2 did not answer" in answer["error"]
