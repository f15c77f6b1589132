"""`scan`: on simulated lines, through a real port."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.cli.main import main
from bridge.config.load import load_config
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from bridge.simulator.tcp import TcpEndpoint
from bridge.simulator.wire import Direction

PATIENT = ["--margin", "300ms"]  # this machine may be busy, and the few silent stations cost little
FOUR = [*PATIENT, "--baud", "19200", "--protocol", "wisco", "--stations", "1-4"]


@pytest.fixture(autouse=True)
def _leave_logging_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.cli.main.configure_logging", lambda *_: None)


def panel(protocol: LineProtocol = LineProtocol.WISCO) -> SimulatedLine:
    """A DIO100 at station 1 and a DO100 at station 3, at 19200 baud."""
    modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 3)]
    return SimulatedLine(protocol, 19200, modules)


def writes(line: SimulatedLine) -> list[bytes]:
    """The frames on the wire that would change something."""
    sent = [entry.data for entry in line.log if entry.direction is Direction.TO_MODULES]
    assert sent
    return [frame for frame in sent if is_write(frame)]


def test_modules_are_listed_a_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    """Address, model, baud rate, protocol and switches; to a pipe nothing else, and no header."""
    with panel() as line:
        assert main(["scan", line.port, *FOUR]) == 0
    captured = capsys.readouterr()
    assert captured.out == (
        "1  DIO100  19200  wisco  10000 01 1  answers modbus-ascii too\n"
        "3  DO100   19200  wisco  11000 01 1  answers modbus-ascii too\n"
    )
    assert captured.err.startswith("2 modules found in ")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize("protocol", LineProtocol)
def test_json_tells_all_of_it(protocol: LineProtocol, capsys: pytest.CaptureFixture[str]) -> None:
    """Programs get one object; what the panel is set to need not be said."""
    with panel(protocol) as line:
        arguments = [line.port, *PATIENT, "--stations", "1,3", "--expect", "2", "--json"]
        assert main(["scan", *arguments, "--baud", "9600,19200"]) == 0
        assert not writes(line)
    document = json.loads(capsys.readouterr().out)
    assert [(one["address"], one["model"]) for one in document["found"]] == [
        (1, "DIO100"),
        (3, "DO100"),
    ]
    rtu = protocol is LineProtocol.MODBUS_RTU
    assert {one["protocol"] for one in document["found"]} == {"modbus-rtu" if rtu else "wisco"}
    assert (document["clashes"], document["port"]) == ([], line.port)
    assert 0 < document["least_seconds"] <= document["seconds"]


@pytest.mark.parametrize("protocol", LineProtocol)
def test_a_whole_scan_writes_nothing(
    protocol: LineProtocol, capsys: pytest.CaptureFixture[str]
) -> None:
    """All baud rates and protocols were asked: the wire log has no frame that writes."""
    with panel(protocol) as line:
        protocols = "wisco,modbus-rtu,modbus-ascii"
        arguments = ["--protocol", protocols, "--stations", "0-5", "--margin", "10ms"]
        assert main(["scan", line.port, *arguments]) in {0, 1}
        assert not writes(line)
        asked = sum(entry.direction is Direction.TO_MODULES for entry in line.log)
        assert not [m for m in line.modules.values() if m.ordered or m.eeprom_writes]
    assert asked >= 4 * (6 + 5 + 3)  # what answers Wisco is not sought in Modbus ASCII
    assert capsys.readouterr().err


def test_what_is_written_passes_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The written configuration passes `check` and has the scanned line."""
    path = tmp_path / "config.yaml"
    with panel() as line:
        assert main(["scan", line.port, *FOUR, "--write", str(path)]) == 0
        (config,) = load_config(path, {"HOME": str(tmp_path)}).lines
        assert main(["-c", str(path), "check"]) == 0
    assert [(s.address, s.model) for s in config.stations] == [(1, DIO100), (3, DO100)]
    assert (config.port, config.baud, config.protocol) == (line.port, 19200, LineProtocol.WISCO)
    assert f"{path} is written" in capsys.readouterr().err


def test_a_file_is_replaced_by_force_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An existing file is only replaced with --force; this is reported before the scan."""
    path = tmp_path / "config.yaml"
    path.write_text("mine\n")
    with panel() as line:
        assert main(["scan", line.port, *FOUR, "--write", str(path)]) == 1
        assert line.log == ()
        assert path.read_text() == "mine\n"
        assert "is there already: --force replaces it" in capsys.readouterr().err
        assert main(["scan", line.port, *FOUR, "--write", str(path), "--force"]) == 0
    assert "DIO100" in path.read_text()


def test_a_folder_that_is_not_there_is_said_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A missing folder is reported before the scan, not after it."""
    path = tmp_path / "none" / "config.yaml"
    with panel() as line:
        assert main(["scan", line.port, "--write", str(path)]) == 1
        assert line.log == ()
    assert "there is no such folder" in capsys.readouterr().err


def test_two_modules_at_one_address_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A clash is printed with its address and the answers; the exit status is 1."""
    path = tmp_path / "config.yaml"
    with panel() as line:
        line.modules[101] = SimulatedModule(DO100, 1)
        assert main(["scan", line.port, *FOUR, "--write", str(path)]) == 1
    out = capsys.readouterr().out
    assert "1  clash  19200  wisco" in out
    assert "two modules with this address?" in out
    assert "Address 1 answers garbled" in path.read_text()


def test_nobody_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a module there is a hint on stderr, nothing on stdout, no file, and status 1."""
    path = tmp_path / "config.yaml"
    with panel() as line:
        arguments = ["--stations", "9", "--protocol", "wisco", "--write", str(path)]
        assert main(["scan", line.port, *arguments]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "no modules found" in captured.err
    assert "are A and B the right way round?" in captured.err
    assert not path.exists()


def test_fewer_than_expected_is_not_fine(capsys: pytest.CaptureFixture[str]) -> None:
    """With --expect 3 and two modules found, the exit status is 1."""
    with panel() as line:
        assert main(["scan", line.port, *FOUR, "--expect", "3"]) == 1
    assert "2 modules found" in capsys.readouterr().err


def test_a_gateway_has_one_baud_rate(capsys: pytest.CaptureFixture[str]) -> None:
    """A gateway is scanned at its own baud rate, with a remark; two rates are refused."""
    modules = [SimulatedModule(DIO100, 1)]
    with SimulatedLine(LineProtocol.WISCO, 57600, modules, endpoint=TcpEndpoint()) as line:
        few = ["--stations", "1,2", "--protocol", "wisco", "--json"]
        assert main(["scan", line.port, *few, "--baud", "57600"]) == 0
        captured = capsys.readouterr()
        assert "only that one is scanned" in captured.err
        assert [one["baud"] for one in json.loads(captured.out)["found"]] == [57600]
        assert main(["scan", line.port, *few, "--baud", "9600,57600"]) == 2
    assert "has one baud rate" in capsys.readouterr().err


def test_noise_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """With the bytes, and what to look at; modules are found all the same."""
    with panel() as line:
        # Station 1 is examined when its reply comes late: it reaches the question to station 2.
        line.faults.set(FaultKind.LATE, address=1, times=1, delay_s=0.2)
        arguments = [line.port, *FOUR[2:], "--margin", "100ms"]
        assert main(["scan", *arguments]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith("3  DO100")
    assert "noise at 19200 baud in wisco, station 2 asked" in captured.err


def test_a_port_that_goes_away_leaves_what_was_found(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The list, then the one line."""
    with panel() as line:
        line.faults.set(FaultKind.HANG_UP, address=3, delay_s=60)
        assert main(["scan", line.port, *FOUR]) == 1
    captured = capsys.readouterr()
    assert captured.out.startswith("1  DIO100  19200")
    assert captured.out.count("\n") == 1
    assert "hung up" in captured.err.splitlines()[-1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_and_what_was_found_is_printed(
    number: signal.Signals, tmp_path: Path
) -> None:
    """Status 130, the list so far, and that it is no whole one."""
    path = tmp_path / "panel.yaml"
    with panel() as line:
        command = [sys.executable, "-m", "bridge", "scan", line.port, *FOUR[2:]]
        process = subprocess.Popen(
            [*command, "--thorough", "--margin", "10s", "--write", str(path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        wait_until(lambda: any(entry.data.startswith(b"#02") for entry in line.log))
        process.send_signal(number)
        out, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert out.startswith("1  DIO100  19200")
    told = f"wisco2mqtt: interrupted: the scan is not at its end; {path} is not written\n"
    assert err.endswith(told)
    assert not path.exists()


def wait_until(condition: Callable[[], bool]) -> None:
    """Waits for a condition, generously."""
    for _ in range(2000):
        if condition():
            return
        time.sleep(0.01)
    pytest.fail("it did not come")


@pytest.mark.parametrize("rich", [True, False])
def test_a_terminal_gets_a_bar_with_the_time_left(rich: bool) -> None:
    """With the extra a fine one, without it a plain one, and no complaint."""
    hide = "" if rich else "import sys; sys.modules['rich.console'] = None\n"
    with panel() as line:
        script = f"{hide}from bridge.cli.main import main\nraise SystemExit(main())\n"
        command = [sys.executable, "-c", script, "scan", line.port, *FOUR]
        status, text = at_a_terminal(command)
    assert status == 0
    assert " left" in text
    assert "19200 baud, wisco, station 2" in text
    assert "DIP switches" in text  # the header
    assert "No module" not in text


def at_a_terminal(command: list[str]) -> tuple[int, str]:
    """Runs a command at a terminal; its status and all that it printed there."""
    master, slave = os.openpty()
    environ = {**os.environ, "TERM": "xterm", "COLUMNS": "160"}
    process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=environ)
    os.close(slave)
    text = b""
    while data := _read(master):
        text += data
    os.close(master)
    return process.wait(20), text.decode()


def _read(master: int) -> bytes:
    try:
        return os.read(master, 4096)
    except OSError:  # the other side is closed
        return b""


def test_help_is_good_to_read(capsys: pytest.CaptureFixture[str]) -> None:
    """The help says that nothing is switched, and what the exit status means."""
    with pytest.raises(SystemExit, match="0"):
        main(["scan", "--help"])
    words = " ".join(capsys.readouterr().out.split())
    assert "It only reads: no output is switched" in words
    assert "Exit status: 0" in words
