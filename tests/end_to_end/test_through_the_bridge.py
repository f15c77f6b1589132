"""The commands for a panel while the daemon has its port: they name it, and go through it."""

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.laptop import Ended, ended_of
from support.line_house import LineHouse, line_house

from bridge.model import LineProtocol
from bridge.protocol.wisco_eeprom import EEPROM_BYTES
from bridge.transcript import load_transcript

PATIENCE_S = 90.0


Run = Callable[..., Ended]


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LineHouse]:
    """A Wisco line at work, whose bytes take no time."""
    directory = tmp_path_factory.mktemp("house")
    with line_house(directory, LineProtocol.WISCO, paced=False) as running:
        yield running


@pytest.fixture
def run(house: LineHouse, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command line with the daemon's configuration, in this process."""
    return lambda *words: ended_of(capsys, "-c", str(house.config), *words)


def test_a_scan_goes_through_the_bridge(house: LineHouse, run: Run) -> None:
    """The busy port's line says how, and what it says finds who is there."""
    busy = run("scan", str(house.line.port), "--stations", "2,9")
    through = "scan --line main --stations 2,9"
    assert busy.status == 1
    assert busy.err.count("\n") == 1
    assert busy.err.endswith(f"go through it: wisco2mqtt -c {house.config} {through}\n")
    found = run(*through.split(), "--json")
    document = json.loads(found.out)
    assert [(one["address"], one["model"]) for one in document["found"]] == [
        (2, "DO100"),
        (9, "DO100"),
    ]
    assert (found.status, found.err) == (0, "")
    table = run(*through.split())
    assert table.out.splitlines()[0].startswith("2  DO100  9600  wisco")
    assert table.err.startswith("2 modules found in ")
    assert "between polls" in table.err
    assert house.writes() == []


def test_whoever_ends_the_command_ends_the_scan(house: LineHouse, run: Run) -> None:
    """Ctrl-C ends the scan of the bridge too: exit 130, and the line is free."""
    command = [sys.executable, "-m", "bridge", "-c", str(house.config), "scan", "--line", "main"]
    house.probe.clear()
    with subprocess.Popen([*command, "--thorough"], stderr=subprocess.PIPE) as process:
        topic = "wisco/bridge/response/scan"
        house.probe.wait_message(topic)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, b"the scan is not at its end\n" in err) == (130, True)
    house.probe.wait_for(
        lambda seen: any(b"it was stopped by a request" in m.payload for m in seen)
    )
    assert run("scan", "--line", "main", "--stations", "2").status == 0


def test_an_eeprom_goes_through_the_bridge(house: LineHouse, run: Run, tmp_path: Path) -> None:
    """Dump and diff; a restore says that it cannot."""
    path = tmp_path / "garage.bin"
    busy = run("eeprom", "dump", "garage", str(path))
    through = f"eeprom dump --broker garage {path}"
    assert busy.err.endswith(f"go through it: wisco2mqtt -c {house.config} {through}\n")
    assert run(*through.split()).status == 0
    assert path.read_bytes() == house.line.module(1).read_eeprom(0, EEPROM_BYTES)
    assert run("eeprom", "diff", "--broker", "garage", str(path)).status == 0
    restore = run("eeprom", "restore", "garage", str(path), "--from", "DIO100")
    assert (restore.status, "systemctl stop wisco2mqtt" in restore.err) == (1, True)
    refused = run("eeprom", "restore", "--broker", "garage", str(path))
    assert (refused.status, "the bridge reads an EEPROM" in refused.err) == (2, True)


def test_settings_on_a_busy_port_name_the_way(house: LineHouse, run: Run) -> None:
    """Modes and hold times are topics."""
    busy = run("settings", "show", "garage")
    assert busy.status == 1
    assert busy.err.endswith(f"go through it: wisco2mqtt -c {house.config} watch garage\n")


def test_a_monitor_goes_through_the_bridge(house: LineHouse, run: Run, tmp_path: Path) -> None:
    """With the same view, counts and records; the transcript can be played back."""
    busy = run("monitor", str(house.line.port))
    assert busy.status == 1
    assert busy.err.count("\n") == 1
    assert busy.err.endswith(f"go through it: wisco2mqtt -c {house.config} monitor --line main\n")
    record, capture = tmp_path / "line.txt", tmp_path / "line.pcapng"
    records = ["--record", str(record), "--record", str(capture)]
    done = run("monitor", "--line", "main", "--for", "3s", *records)
    assert done.status == 0
    first = done.out.splitlines()[0].split()
    assert first[0] == "0.000"
    assert ">" in first
    assert "read inputs" in done.out
    counts = done.err.splitlines()
    assert [row.split()[0] for row in counts[:2]] == ["station", "1"]
    transcript = load_transcript(record)
    assert (transcript.protocol, transcript.baud) == (LineProtocol.WISCO, 9600)
    assert len(transcript.entries) == len(done.out.splitlines())
    if shutil.which("tshark"):
        rows = subprocess.run(
            ["tshark", "-r", str(capture)], check=True, capture_output=True, text=True
        ).stdout.splitlines()
        assert len(rows) == len(transcript.entries)
