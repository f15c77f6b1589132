"""Errands of the daemon on its own line: a scan, and the dump of an EEPROM."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.line_house import STRANGER, LineHouse, line_house
from support.panel import BASE

from bridge.commission.image import parse_image
from bridge.model import DIO100, DO100, LineProtocol
from bridge.protocol.wisco_eeprom import EEPROM_BYTES
from bridge.simulator.module import SimulatedModule


@pytest.fixture
def house(tmp_path: Path) -> Iterator[LineHouse]:
    """A Wisco line at the pace of the wire."""
    with line_house(tmp_path, LineProtocol.WISCO) as running:
        yield running


@pytest.mark.parametrize("protocol", [LineProtocol.WISCO, LineProtocol.MODBUS_RTU])
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
        if protocol is LineProtocol.MODBUS_RTU:  # it has no way to an EEPROM
            assert "Wisco frames alone" in house.refusal("eeprom", "e1", station="garage")


def test_a_clash_is_named_and_disturbs_nobody(house: LineHouse) -> None:
    """Two strangers with one address: found out between polls of modules that are well."""
    house.line.modules[101] = SimulatedModule(DO100, STRANGER)
    house.line.modules[101].set_output(1, True)
    house.ask("scan", "s1", line="main", stations=f"{STRANGER}")
    data = house.final("scan", "s1")["data"]
    assert [clash["address"] for clash in data["clashes"]] == [STRANGER]
    assert data["found"] == []
    assert not [m for m in house.probe.seen if m.payload == b"offline"]


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
