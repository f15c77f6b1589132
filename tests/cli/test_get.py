"""`get`: on simulated lines, through a real port."""

import json
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.one_panel import GARAGE, PUMPS, flags, one_panel

from bridge.cli.main import main
from bridge.model import LineProtocol
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.wire import Direction
from bridge.transport.opener import open_port


@pytest.fixture(autouse=True)
def _leave_logging_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.cli.main.configure_logging", lambda *_: None)


@pytest.mark.parametrize("protocol", LineProtocol)
def test_everything_of_a_station_is_read(
    protocol: LineProtocol, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line a value, named as topics are; inverted and left out as the configuration says."""
    with one_panel(tmp_path, protocol) as (line, path):
        line.module(GARAGE).set_input(3, value=True)
        line.module(GARAGE).set_output(1, value=True)
        line.module(GARAGE).set_mode(5, pulse=True, hold_s=2.5)
        assert main(["-c", str(path), "get", "garage"]) == 0
        sent = [entry.data for entry in line.log if entry.direction is Direction.TO_MODULES]
    captured = capsys.readouterr()
    values = dict(text.split(" ") for text in captured.out.splitlines())
    assert len(values) == 15 + 3 * 8
    on = {name for name, value in values.items() if value == "ON"}
    assert on == {"di/2", "di/3", "do/1"}
    assert (values["do/5/mode"], values["do/5/hold"]) == ("pulse", "2.5")
    assert (values["do/1/mode"], values["do/1/hold"]) == ("latch", "1.0")
    assert f"garage: DIO100, station 1, 57600 baud, {protocol}; read in " in captured.err
    assert sent
    assert not [frame for frame in sent if is_write(frame)]


@pytest.mark.parametrize("protocol", LineProtocol)
def test_a_model_that_is_not_given_is_asked(
    protocol: LineProtocol, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By flags alone: a DO100 has 16 outputs and no inputs."""
    with one_panel(tmp_path, protocol) as (line, _):
        line.module(PUMPS).set_output(16, value=True)
        assert main(["get", *flags(line, PUMPS)]) == 0
    captured = capsys.readouterr()
    values = dict(text.split(" ") for text in captured.out.splitlines())
    assert len(values) == 3 * 16
    assert values["do/16"] == "ON"
    assert "station 2: DO100" in captured.err


@pytest.mark.parametrize(
    ("target", "out"),
    [
        ("do/3", "ON\n"),
        ("di/1", "OFF\n"),
        ("do/3/mode", "pulse\n"),
        ("do/3/hold", "25.5\n"),
        ("di", "".join(f"di/{n} OFF\n" for n in range(1, 17))),
    ],
)
def test_one_channel_prints_its_value_alone(
    target: str, out: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """For scripts; several print a line each."""
    with one_panel(tmp_path) as (line, _):
        line.module(GARAGE).set_mode(3, pulse=True, hold_s=25.5)
        line.module(GARAGE).set_output(3, value=True)
        assert main(["get", *flags(line, GARAGE), "--model", "DIO100", target]) == 0
    assert capsys.readouterr().out == out


def test_json_is_one_object(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The JSON object has the values, the module, and the time."""
    with one_panel(tmp_path) as (line, path):
        line.module(PUMPS).set_output(2, value=True)
        assert main(["-c", str(path), "get", "pumps", "do/2", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document.pop("ms") > 0
    assert document == {
        "station": "pumps",
        "address": 2,
        "model": "DO100",
        "values": {"do/2": "ON"},
    }


def test_lost_replies_are_asked_for_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two in a row are no failure."""
    with one_panel(tmp_path, LineProtocol.MODBUS_RTU) as (line, path):
        line.faults.set(FaultKind.SILENT, times=2)
        assert main(["-c", str(path), "get", "garage", "do/1"]) == 0
    assert capsys.readouterr().out == "OFF\n"


def test_an_echo_is_no_answer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the adapter's echo a dead station stays dead, and a live one is read."""
    with one_panel(tmp_path) as (line, path):
        line.faults.set(FaultKind.ECHO)
        assert main(["-c", str(path), "get", "garage", "do/1"]) == 0
        line.module(GARAGE).away = True
        assert main(["-c", str(path), "get", "garage", "do/1"]) == 1
    assert capsys.readouterr().out == "OFF\n"


def test_a_module_without_modbus_has_no_modes_to_show(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A module without Modbus frames shows its channels; a request for its modes is an error."""
    with one_panel(tmp_path) as (line, _):
        line.module(GARAGE).wisco_only = True
        assert main(["get", *flags(line, GARAGE), "--model", "DIO100"]) == 0
        assert len(capsys.readouterr().out.splitlines()) == 24
        assert main(["get", *flags(line, GARAGE), "--model", "DIO100", "do/1/mode"]) == 2
    assert "or it takes no Modbus frames" in capsys.readouterr().err


@pytest.mark.parametrize("known", [["--model", "DIO100"], []])
def test_nobody_there_is_one_line(
    known: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without an answer one line says what was asked, and which command finds out more."""
    with one_panel(tmp_path) as (line, _):
        assert main(["get", *flags(line, 9), *known]) == 1
    captured = capsys.readouterr()
    assert captured.err == (
        f"wisco2mqtt: station 9 does not answer wisco at 57600 baud on {line.port}: "
        f"`wisco2mqtt scan {line.port}` finds out who does\n"
    )
    assert captured.out == ""


def test_another_model_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Another model is named in one line, and none of its values is printed."""
    with one_panel(tmp_path) as (line, _):
        assert main(["get", *flags(line, PUMPS), "--model", "DIO100"]) == 1
    captured = capsys.readouterr()
    assert "station 2 is configured as DIO100, but it has no inputs to read" in captured.err
    assert captured.out == ""


def test_two_at_one_address_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two modules with one address are reported as such when the model is asked for."""
    with one_panel(tmp_path) as (line, _):
        line.modules[101] = type(line.module(PUMPS))(line.module(PUMPS).model, GARAGE)
        assert main(["get", *flags(line, GARAGE)]) == 1
    captured = capsys.readouterr()
    assert "as when two modules have one address" in captured.err
    assert captured.err.count("\n") == 1


def test_a_busy_port_offers_the_way_through_the_broker(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line to copy, with the file and the station's id."""
    with one_panel(tmp_path) as (line, path):
        port = open_port(line.port, 57600)
        try:
            assert main(["-c", str(path), "get", "garage", "do/1"]) == 1
        finally:
            port.close()
    error = capsys.readouterr().err
    assert "another program holds it" in error
    assert error.endswith(f"go through it: wisco2mqtt -c {path} watch garage\n")
    assert error.count("\n") == 1


@pytest.mark.parametrize("there", [True, False])
def test_a_busy_port_named_by_flags_is_sought_in_the_configuration(
    there: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For a busy port named by flags, the line to copy has the id from the configuration."""
    monkeypatch.chdir(tmp_path)
    with one_panel(tmp_path) as (line, path):
        if not there:
            path.rename(tmp_path / "other.yaml")
        port = open_port(line.port, 57600)
        try:
            assert main(["get", *flags(line, PUMPS)]) == 1
        finally:
            port.close()
    offer = "wisco2mqtt -c config.yaml watch pumps" if there else "wisco2mqtt watch STATION"
    assert capsys.readouterr().err.endswith(f": {offer}\n")


def test_a_channel_that_the_model_lacks_is_wrong_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A channel that the model lacks, or an unknown station, is wrong usage."""
    with one_panel(tmp_path) as (line, path):
        assert main(["get", *flags(line, PUMPS), "di/1"]) == 2
        assert "station 2 is a DO100 and has no di/1" in capsys.readouterr().err
        assert main(["-c", str(path), "get", "cellar"]) == 2
    assert "there is no station cellar" in capsys.readouterr().err


# --- until Ctrl-C ---


@contextmanager
def watching(path: Path, *arguments: str) -> Iterator[tuple["subprocess.Popen[str]", "Lines"]]:
    """`get --watch` in a process of its own."""
    command = [sys.executable, "-m", "bridge", "-c", str(path), "get", "garage"]
    with subprocess.Popen(
        [*command, *arguments, "--watch"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process, Lines(process)
        finally:
            process.kill()


class Lines:
    """The lines that a process prints on stdout, as they come."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._queue: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, args=(process,), daemon=True).start()

    def _read(self, process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        for text in process.stdout:
            self._queue.put(text.rstrip("\n"))

    def next(self) -> str:
        """The next line; generously waited for."""
        return self._queue.get(timeout=20)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_watch_prints_what_is_there_and_then_what_changes(
    number: signal.Signals, tmp_path: Path
) -> None:
    """Until a signal, which is a fine end."""
    with one_panel(tmp_path) as (line, path), watching(path, "di") as (process, lines):
        first = [lines.next() for _ in range(15)]
        assert [text.split(" ", 1)[1] for text in first[:2]] == ["= di/1 OFF", "= di/2 ON"]
        line.module(GARAGE).set_input(7, value=True)
        assert lines.next().split(" ")[1:] == ["di/7", "ON"]
        line.module(GARAGE).set_output(1, value=True)  # not asked for
        line.module(GARAGE).set_input(7, value=False)
        assert lines.next().split(" ")[1:] == ["di/7", "OFF"]
        process.send_signal(number)
        assert process.wait(20) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""


def test_watch_tells_when_the_module_goes_and_comes(tmp_path: Path) -> None:
    """On stderr, once each; what changed meanwhile is printed."""
    with one_panel(tmp_path) as (line, path), watching(path, "do/1", "--json") as (process, lines):
        assert process.stderr is not None
        first = json.loads(lines.next())
        assert (first["target"], first["value"]) == ("do/1", "OFF")
        line.module(GARAGE).away = True
        assert process.stderr.readline().startswith("garage does not answer: ")
        line.module(GARAGE).set_output(1, value=True)
        line.module(GARAGE).away = False
        assert process.stderr.readline() == "garage answers again\n"
        assert json.loads(lines.next())["value"] == "ON"


def test_a_terminal_gets_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the names of the configuration, mode and hold time beside the state."""
    with one_panel(tmp_path) as (_, path):
        monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
        assert main(["-c", str(path), "get", "garage"]) == 0
    rows = [
        [cell.strip() for cell in row.split("│")] for row in capsys.readouterr().out.split("\n")
    ]
    assert ["", "do/1", "OFF", "latch", "1.0 s", "Lamp", ""] in rows
