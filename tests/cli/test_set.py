"""`set`: on simulated lines, through a real port."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.one_panel import GARAGE, PUMPS, flags, one_panel

from bridge.cli.main import main
from bridge.model import LineProtocol
from bridge.simulator.faults import FaultKind, is_write
from bridge.transport.opener import open_port


@pytest.fixture(autouse=True)
def _leave_logging_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.cli.main.configure_logging", lambda *_: None)


def verdict_of(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    """The verdict that was printed as JSON, without its time."""
    document: dict[str, object] = json.loads(capsys.readouterr().out)
    assert document.pop("ms") is not None
    return document


@pytest.mark.parametrize("protocol", LineProtocol)
def test_an_output_is_switched_and_read_back(
    protocol: LineProtocol, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The verdict and its time take one line."""
    with one_panel(tmp_path, protocol) as (line, path):
        assert main(["-c", str(path), "set", "garage", "do/3", "on"]) == 0
        assert line.module(GARAGE).outputs == 0b100
        assert dict(line.module(GARAGE).ordered) == {(3, True): 1}
    out = capsys.readouterr().out
    assert out.startswith("garage do/3 ON: done in ")
    assert out.count("\n") == 1


@pytest.mark.parametrize("protocol", LineProtocol)
def test_several_go_in_one_write(
    protocol: LineProtocol, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By flags alone, and the model is asked; the outputs between them stay."""
    with one_panel(tmp_path, protocol) as (line, _):
        line.module(PUMPS).set_output(4, value=True)
        line.module(PUMPS).set_output(2, value=True)
        assert main(["set", *flags(line, PUMPS), "do", "1=ON,4=OFF,16=ON", "--json"]) == 0
        assert line.module(PUMPS).outputs == 0b1000_0000_0000_0011
    assert verdict_of(capsys) == {
        "target": "do",
        "payload": {"1": "ON", "4": "OFF", "16": "ON"},
        "status": "done",
    }


def test_toggle_and_press(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """TOGGLE turns a latch over; PRESS starts a pulse, and a latch is not pressed."""
    with one_panel(tmp_path) as (line, path):
        garage = line.module(GARAGE)
        garage.set_mode(2, pulse=True, hold_s=25.5)
        garage.set_output(1, value=True)
        command = ["-c", str(path), "set", "garage"]
        assert main([*command, "do/1", "TOGGLE"]) == 0
        assert main([*command, "do/2", "PRESS"]) == 0
        assert garage.outputs == 0b10
        assert main([*command, "do/1", "PRESS"]) == 1
        assert garage.outputs == 0b10
        assert main([*command, "do/2", "TOGGLE"]) == 1
        assert garage.ordered == {(1, False): 1, (2, True): 1}
    out = capsys.readouterr().out.splitlines()
    assert "refused: bad_payload; it is no pulse output: it would stay ON" in out[2]
    assert "refused: bad_payload; a pulse output is not toggled" in out[3]


def test_an_interlocked_output_waits_its_dead_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was ON before is not known: it waits, then it switches, unless another is ON."""
    with one_panel(tmp_path) as (line, path):
        text = path.read_text().replace("id: garage", "id: garage, interlock: [[1, 2]]")
        path.write_text(text)
        began = time.monotonic()
        assert main(["-c", str(path), "set", "garage", "do/2", "ON", "--json"]) == 0
        assert time.monotonic() - began >= 0.5
        assert verdict_of(capsys)["status"] == "done"
        assert main(["-c", str(path), "set", "garage", "do/1", "ON", "--json"]) == 1
        assert line.module(GARAGE).outputs == 0b10
    assert verdict_of(capsys)["reason"] == "interlock"


def test_a_pulse_is_sent_once_and_a_lost_reply_is_no_failure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was read afterwards counts, as it does in the bridge."""
    with one_panel(tmp_path) as (line, path):
        garage = line.module(GARAGE)
        garage.set_mode(2, pulse=True, hold_s=25.5)
        line.faults.set(FaultKind.SILENT, only=is_write)
        main(["-c", str(path), "set", "garage", "do/2", "PRESS", "--json"])
        assert garage.ordered == {(2, True): 1}
    assert verdict_of(capsys)["status"] != "refused"


def test_what_the_module_refuses_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With its code, and status 1."""
    with one_panel(tmp_path, LineProtocol.MODBUS_RTU) as (line, path):
        line.faults.set(FaultKind.REFUSE, only=is_write)
        assert main(["-c", str(path), "set", "garage", "do/3", "ON"]) == 1
    assert "garage do/3 ON: failed: module_refused (code 4)" in capsys.readouterr().out


def test_an_output_for_reading_is_not_switched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The configuration says so, alone and among others; nothing is sent."""
    with one_panel(tmp_path) as (line, path):
        assert main(["-c", str(path), "set", "garage", "do/8", "ON"]) == 1
        assert main(["-c", str(path), "set", "garage", "do", "1=ON,8=ON"]) == 1
        assert not line.module(GARAGE).ordered
    assert capsys.readouterr().out.count("refused: read_only") == 2


# --- modes and hold times ---


@pytest.mark.parametrize("protocol", LineProtocol)
def test_a_mode_and_a_hold_time_are_written_and_read_back(
    protocol: LineProtocol, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In Modbus frames, on a Wisco line too; the other outputs keep theirs."""
    with one_panel(tmp_path, protocol) as (line, path):
        garage = line.module(GARAGE)
        garage.set_mode(5, pulse=True)
        command = ["-c", str(path), "set", "garage"]
        assert main([*command, "do/2/hold", "0.5"]) == 0
        assert main([*command, "do/2/mode", "pulse"]) == 0
        assert garage.settings.pulse == 0b10010
        assert garage.settings.hold_ds[:2] == (10, 5)
        assert garage.eeprom_writes == 2
        assert main([*command, "do/2/mode", "latch"]) == 0
        assert garage.settings.pulse == 0b10000
        assert not garage.ordered
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith("garage do/2/hold 0.5: done in ")
    assert out[1].startswith("garage do/2/mode pulse: done in ")


def test_what_is_so_already_wears_no_eeprom(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is written, and it is done."""
    with one_panel(tmp_path) as (line, path):
        assert main(["-c", str(path), "set", "garage", "do/2/hold", "1s"]) == 0
        assert line.module(GARAGE).eeprom_writes == 0
    assert capsys.readouterr().out.startswith("garage do/2/hold 1: done in ")


def test_a_setting_that_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The verdict tells the code, and the status is 1."""
    with one_panel(tmp_path) as (line, path):
        line.faults.set(FaultKind.REFUSE, only=is_write)
        assert main(["-c", str(path), "set", "garage", "do/2/mode", "pulse", "--json"]) == 1
    verdict = verdict_of(capsys)
    assert (verdict["target"], verdict["payload"]) == ("do/2/mode", "pulse")
    assert (verdict["status"], verdict["reason"], verdict["code"]) == (
        "failed",
        "module_refused",
        4,
    )


def test_a_setting_whose_reply_is_lost_is_read_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What the module holds counts, and it is written once."""
    with one_panel(tmp_path, LineProtocol.MODBUS_RTU) as (line, path):
        line.faults.set(FaultKind.SILENT, only=is_write)
        assert main(["-c", str(path), "set", "garage", "do/2/hold", "2.5", "--json"]) == 0
        assert line.module(GARAGE).eeprom_writes == 1
    assert verdict_of(capsys) == {"target": "do/2/hold", "payload": 2.5, "status": "done"}


def test_a_module_without_modbus_has_no_settings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The verdict says why."""
    with one_panel(tmp_path) as (line, path):
        line.module(GARAGE).wisco_only = True
        assert main(["-c", str(path), "set", "garage", "do/2/mode", "pulse"]) == 1
    assert "reached in Modbus frames alone" in capsys.readouterr().out


# --- what goes wrong before ---


@pytest.mark.parametrize(
    ("words", "offer"),
    [
        (["do", "1=ON,4=OFF"], "send garage do 1=ON,4=OFF"),
        (["do/3", "on"], "send garage do/3 ON"),
        (["do/2/mode", "pulse"], "send garage do/2/mode pulse"),
    ],
)
def test_a_busy_port_offers_the_way_through_the_broker(
    words: list[str], offer: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line to copy that does the same."""
    with one_panel(tmp_path) as (line, path):
        port = open_port(line.port, 57600)
        try:
            assert main(["-c", str(path), "set", "garage", *words]) == 1
        finally:
            port.close()
    error = capsys.readouterr().err
    assert "another program holds it" in error
    assert error.endswith(f": wisco2mqtt -c {path} {offer}\n")


def test_nobody_there_switches_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, status 1, and no write on the wire."""
    with one_panel(tmp_path) as (line, path):
        line.module(GARAGE).away = True
        assert main(["-c", str(path), "set", "garage", "do/3", "ON"]) == 1
        assert not [entry for entry in line.log if is_write(entry.data)]
    assert "station 1 does not answer wisco at 57600 baud" in capsys.readouterr().err


def test_another_model_is_not_switched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What it would do is anybody's guess."""
    with one_panel(tmp_path) as (line, _):
        assert main(["set", *flags(line, PUMPS), "--model", "DIO100", "do/3", "ON"]) == 1
        assert not [entry for entry in line.log if is_write(entry.data)]
    assert "configured as DIO100" in capsys.readouterr().err


def test_an_interrupted_set_is_not_taken_for_done(tmp_path: Path) -> None:
    """Status 130, and a line: it cannot be told."""
    with one_panel(tmp_path) as (line, path):
        line.faults.set(FaultKind.SILENT, only=is_write)
        command = [sys.executable, "-m", "bridge", "-c", str(path), "set", "garage", "do/3", "ON"]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 20
        while not any(is_write(entry.data) for entry in line.log):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert err == (
        "wisco2mqtt: interrupted: garage do/3 ON is not known: "
        "`wisco2mqtt get` reads what became of it\n"
    )
