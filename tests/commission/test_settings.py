"""Modes and hold times: YAML in and out, only what differs written, and read back."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.panel_bus import bus_on

from bridge.commission.settings import (
    NotAppliedError,
    SettingsAccess,
    WantedOutput,
    changes_for,
)
from bridge.commission.settings_file import format_settings, load_settings
from bridge.drivers.modbus import ModbusDriver
from bridge.errors import ConfigError, RefusedError
from bridge.model import DIO100, DO100, LineProtocol, ModuleType, OutputSettings
from bridge.simulator import FaultKind, SimulatedLine, SimulatedModule, is_write

STATION = 7
PLAIN = OutputSettings(pulse=0, hold_ds=(10,) * 8)


@pytest.fixture(params=[LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII])
def line(request: pytest.FixtureRequest) -> Iterator[SimulatedLine]:
    """One DIO100 on a line that takes no time, in each Modbus framing."""
    module = SimulatedModule(DIO100, STATION)
    with SimulatedLine(request.param, 57600, [module], paced=False, turnaround_s=0.0) as line:
        yield line


def apply(line: SimulatedLine, *wanted: WantedOutput, timeout_s: float = 2.0) -> int:
    """Applies what is wanted; returns how many registers were written."""
    with bus_on(line, timeout_s) as bus:
        access = SettingsAccess(bus, ModbusDriver(STATION, DIO100, line.protocol))
        return access.apply(access.read(), wanted, lambda: None)


# --- YAML ---


@pytest.mark.parametrize("model", [DIO100, DO100])
def test_what_is_shown_can_be_applied(model: ModuleType, tmp_path: Path) -> None:
    """`show` prints YAML that wants just what the module has."""
    settings = OutputSettings(0b101, tuple(range(1, model.outputs + 1)))
    path = tmp_path / "settings.yaml"
    path.write_text(format_settings("station 7", model, settings))
    wanted = load_settings(path, model)
    assert len(wanted) == model.outputs
    assert changes_for(settings, wanted) == ()
    assert path.read_text().splitlines()[:4] == [
        "# station 7", f"model: {model.name}", "outputs:", "  1: {mode: pulse, hold: 0.1s}"
    ]  # fmt: skip


def test_what_is_left_out_stays(tmp_path: Path) -> None:
    """A file may speak of one output's hold time alone."""
    path = tmp_path / "settings.yaml"
    path.write_text("outputs:\n  3: {hold: 2.5s}\n")
    assert load_settings(path, DIO100) == (WantedOutput(3, None, 25),)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            "outputs:\n  9: {mode: pulse}\n",
            "2:3: outputs: no output 9 here; a DIO100 has outputs 1 to 8",
        ),
        ("outputs:\n  1: {mode: puls}\n", "2:13: outputs.1.mode: puls is not known here"),
        ("outputs:\n  1: {hold: 30s}\n", "2:13: outputs.1.hold: 30s is out of range"),
        ("outputs:\n  1: {held: 3s}\n", "2:7: outputs.1: unknown key held; did you mean hold?"),
        (
            "model: DO100\noutputs:\n  12: {mode: pulse}\n",
            "1:8: model: these are settings of a DO100",
        ),
        ("model: DIO100\n", "1:1: outputs is missing"),
        ("[", "cannot be read as YAML"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(text: str, complaint: str, tmp_path: Path) -> None:
    """Each problem names file, line and column."""
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_settings(path, DIO100)
    assert complaint in str(caught.value)
    assert len(caught.value.problems) == 1


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    """The problem says which."""
    with pytest.raises(ConfigError, match=r"gone\.yaml:1:1: the settings cannot be read: No such"):
        load_settings(tmp_path / "gone.yaml", DIO100)


# --- what differs ---


def test_changes_are_told_in_words() -> None:
    """Mode and hold time, each as it is and as it is wanted."""
    changes = changes_for(PLAIN, [WantedOutput(2, True, 5), WantedOutput(3, False, 10)])
    assert [str(change) for change in changes] == [
        "do/2 mode: latch -> pulse",
        "do/2 hold: 1.0s -> 0.5s",
    ]


# --- on the wire ---


def test_only_what_differs_is_written(line: SimulatedLine) -> None:
    """Two hold times and the mode register are three writes, however many outputs are named."""
    wanted = [WantedOutput(output, output in (2, 5), 5 if output in (2, 5) else 10)
              for output in range(1, 9)]  # fmt: skip
    assert apply(line, *wanted) == 3
    module = line.module(STATION)
    assert module.eeprom_writes == 3
    assert module.settings == OutputSettings(0b10010, (10, 5, 10, 10, 5, 10, 10, 10))


def test_nothing_is_written_where_nothing_differs(line: SimulatedLine) -> None:
    """The second run finds all as it should be."""
    assert apply(line, WantedOutput(1, False, 10)) == 0
    assert line.module(STATION).eeprom_writes == 0


def test_an_output_is_a_pulse_only_once_its_hold_time_is_set(line: SimulatedLine) -> None:
    """An interrupted run leaves no pulse of a length that was not chosen."""
    line.faults.set(FaultKind.REFUSE, only=is_write)
    with pytest.raises(RefusedError):
        apply(line, WantedOutput(1, True, 200))
    assert line.module(STATION).settings.pulse == 0


def test_lost_replies_are_asked_for_again(line: SimulatedLine) -> None:
    """Writing the same value again does no harm; reading neither."""
    line.faults.set(FaultKind.SILENT, times=2)
    assert apply(line, WantedOutput(1, True, 200), timeout_s=0.3) == 2
    assert line.module(STATION).settings.hold_ds[0] == 200


def test_what_the_module_does_not_keep_is_named(
    line: SimulatedLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Confirmed and not held is a failure that says which setting."""
    monkeypatch.setattr(SimulatedModule, "write_eeprom", lambda *_: None)
    with pytest.raises(NotAppliedError, match=r"do/1 hold: 1.0s -> 20.0s"):
        apply(line, WantedOutput(1, None, 200))
