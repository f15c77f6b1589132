"""`wisco2mqtt monitor`, as a process of its own beside a line where a master is at work."""

import json
import shutil
import signal
import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from support.laptop import ended_of
from support.monitor import Monitor
from support.panel_bus import bus_on
from support.tapped_line import TAP, tapped_line

from bridge.drivers import driver_for
from bridge.errors import ExchangeError
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import FaultKind, SimulatedLine, SimulatedModule
from bridge.transcript import load_transcript

PATIENCE_S = 20.0
ROUNDS = 20
PROTOCOLS = list(LineProtocol)


def poll(line: SimulatedLine, rounds: int = ROUNDS) -> int:
    """A master at work: inputs, outputs, a write now and then. Returns the exchanges."""
    driver = driver_for(line.protocol, 1, DIO100)
    with bus_on(line) as bus:
        for number in range(rounds):
            line.module(1).set_input(number % 16 + 1, True)
            bus.exchange(driver.read_inputs, protected=driver.protected)
            outputs = bus.exchange(driver.read_outputs, protected=driver.protected)
            write = driver.write_outputs(1 << number % 8, 1 << number % 8, outputs)
            bus.exchange(write, protected=driver.protected)
    return 3 * rounds


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_frame_is_shown_and_recorded(protocol: LineProtocol, tmp_path: Path) -> None:
    """In each protocol: each request with its reply, in words, without a complaint."""
    with (
        tapped_line(tmp_path, protocol, SimulatedModule(DIO100, 1)) as line,
        Monitor(tmp_path, "--json") as monitor,
    ):
        exchanges = poll(line)
        monitor.wait_for_entries(2 * exchanges)
        told = monitor.end()
    heard = [json.loads(text) for text in monitor.out.read_text().splitlines()]
    assert [one["direction"] for one in heard] == ["request", "reply"] * exchanges
    assert {one["protocol"] for one in heard} == {protocol.value}
    assert {(one["station"], one["problem"]) for one in heard} == {(1, None)}
    assert heard[1]["meaning"] == "inputs ON: 1"
    assert heard[5]["meaning"].startswith("done")
    # A busy machine may hear a request and its reply at one look: then no time lies between.
    replies_ms = [one["reply_ms"] for one in heard[1::2]]
    assert min(replies_ms) >= 0 < max(replies_ms)
    assert told.splitlines()[1].split()[:6] == ["1", f"{exchanges}", f"{exchanges}", "0", "0", "0"]
    transcript = load_transcript(monitor.record)
    assert (transcript.protocol, transcript.baud) == (protocol, 19200)
    wire = b"".join(entry.data for entry in line.log)
    assert b"".join(entry.data for entry in transcript.entries) == wire


def test_lines_for_people_show_text_frames_as_text(tmp_path: Path) -> None:
    """No colour goes into a file, and nothing but lines of frames."""
    with (
        tapped_line(tmp_path, LineProtocol.WISCO, SimulatedModule(DIO100, 1)) as line,
        Monitor(tmp_path) as monitor,
    ):
        poll(line, rounds=1)
        monitor.wait_for_entries(6)
        monitor.end()
    shown = [text.split(maxsplit=5) for text in monitor.out.read_text().splitlines()]
    assert len(shown) == 6
    assert shown[1][2:] == ["<", "1", "DI>0001\\r", "inputs ON: 1"]


def test_trouble_is_named_and_counted(tmp_path: Path) -> None:
    """Silence, refusals and damaged replies, each with its station."""
    modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)]
    with (
        tapped_line(tmp_path, LineProtocol.MODBUS_RTU, *modules) as line,
        Monitor(tmp_path, "--json") as monitor,
        bus_on(line, timeout_s=0.3) as bus,
    ):
        line.faults.set(FaultKind.FLIP, address=1, bit=40, times=1)
        for address, model in ((1, DIO100), (1, DIO100), (2, DIO100), (3, DIO100)):
            request = driver_for(line.protocol, address, model).read_inputs
            with suppress(ExchangeError):
                bus.exchange(request, protected=True)
        monitor.wait_until(lambda: "station 3" in monitor.out.read_text())
        told = monitor.end()
    heard = [json.loads(text) for text in monitor.out.read_text().splitlines()]
    assert [one["problem"] for one in heard if one["problem"]] == [
        "an RTU frame of station 1 with a wrong CRC, or a part of one",
        "refused: illegal function",
        "station 3 did not answer",
    ]
    counts = {row.split()[0]: row.split()[1:6] for row in told.splitlines()[1:]}
    #                        requests, replies, refused, no reply, damaged
    assert counts == {"1": ["2", "1", "0", "0", "1"], "2": ["1", "0", "1", "0", "0"],
                      "3": ["1", "0", "0", "1", "0"]}  # fmt: skip


@pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed")
def test_wireshark_decodes_every_frame(tmp_path: Path) -> None:
    """A record of an RTU line is Modbus from its first packet to its last."""
    capture = tmp_path / "record.pcapng"
    with (
        tapped_line(tmp_path, LineProtocol.MODBUS_RTU, SimulatedModule(DIO100, 1)) as line,
        Monitor(tmp_path, "--quiet", "--record", str(capture)) as monitor,
    ):
        exchanges = poll(line)
        monitor.wait_for_entries(2 * exchanges)
        monitor.end(signal.SIGTERM)
    assert monitor.out.read_bytes() == b""
    decoded = subprocess.run(
        ["tshark", "-r", str(capture), "-d", "rtacser.data,mbrtu",
         "-o", "mbrtu.crc_verification:TRUE", "-T", "fields", "-e", "_ws.col.Protocol",
         "-e", "mbrtu.unit_id", "-e", "modbus.func_code", "-e", "mbrtu.crc16.status"],
        check=True, capture_output=True, text=True, timeout=PATIENCE_S,
    ).stdout.splitlines()  # fmt: skip
    assert len(decoded) == 2 * exchanges
    assert {row.split("\t")[0] for row in decoded} == {"Modbus RTU"}
    assert [row.split("\t")[1:3] for row in decoded[:6]] == [
        ["1", "2"], ["1", "2"], ["1", "1"], ["1", "1"], ["1", "5"], ["1", "5"]
    ]  # fmt: skip
    assert {row.split("\t")[3] for row in decoded} == {"1"}


# --- what goes wrong ---


Fails = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def fails(capsys: pytest.CaptureFixture[str]) -> Fails:
    """Runs the command to its end; returns its status and what it said."""

    def run(*arguments: str) -> tuple[int, list[str]]:
        done = ended_of(capsys, "monitor", *arguments)
        assert done.out == ""
        return done.status, done.err.splitlines()

    return run


def test_a_record_is_never_overwritten(tmp_path: Path, fails: Fails) -> None:
    """An existing record is never overwritten."""
    (tmp_path / "a.txt").write_text("precious")
    with tapped_line(tmp_path, LineProtocol.WISCO) as line:
        status, lines = fails(line.port, "--record", str(tmp_path / "a.txt"))
    assert (status, len(lines)) == (1, 1)
    assert "is there already" in lines[0]
    assert (tmp_path / "a.txt").read_text() == "precious"


def test_a_line_where_nothing_passes_is_told(tmp_path: Path, fails: Fails) -> None:
    """A line without bytes is reported, and so is one with only noise."""
    with tapped_line(tmp_path, LineProtocol.WISCO) as line:
        status, lines = fails(str(tmp_path / TAP), "--for", "200ms")
        assert (status, "nothing passed" in lines[-1]) == (0, True)
        monitor = Monitor(tmp_path)
        with monitor:
            for count in range(1, 6):
                line.inject(b"\xff\xfe")
                monitor.wait_for_entries(count)
            told = monitor.end()
    assert "is --baud right" in told.splitlines()[-1]
