"""The configuration that a scan writes: it loads as it stands."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from bridge.commission.findings import Clash, Found
from bridge.commission.proposal import configuration
from bridge.config.load import load_config
from bridge.config.schema import LineConfig
from bridge.model import DIO100, DO100, LineProtocol, ModuleType, OutputSettings

WISCO = (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
RTU = (LineProtocol.MODBUS_RTU,)


def found(
    address: int,
    model: ModuleType = DIO100,
    *,
    baud: int = 19200,
    protocols: tuple[LineProtocol, ...] = WISCO,
    settings: OutputSettings | None = None,
) -> Found:
    """A module that answered well."""
    return Found(address, model, baud, protocols, settings, damaged=0, asked=4)


def load(
    directory: Path, modules: Sequence[Found], port: str = "/dev/ttyUSB0", *clashes: Clash
) -> tuple[str, LineConfig]:
    """Writes the configuration and loads it: the text, and its one line."""
    text = configuration(port, modules, clashes)
    path = directory / "config.yaml"
    path.write_text(text)
    (line,) = load_config(path, {"HOME": str(directory)}).lines
    return text, line


def test_what_answered_becomes_a_line(tmp_path: Path) -> None:
    """Port, baud rate, protocol, and every module with its model, by address."""
    text, line = load(tmp_path, [found(5, DO100), found(1), found(13)])
    assert (line.port, line.baud, line.protocol) == ("/dev/ttyUSB0", 19200, LineProtocol.WISCO)
    assert [(s.address, s.model) for s in line.stations] == [(1, DIO100), (5, DO100), (13, DIO100)]
    assert [s.id for s in line.stations] == ["main_01", "main_05", "main_13"]
    assert "DIP 10110 01 1" in text


def test_pulse_outputs_are_declared_as_the_module_has_them(tmp_path: Path) -> None:
    """Outputs in pulse mode are declared so; an impossible hold time is left out."""
    settings = OutputSettings(pulse=0b101, hold_ds=(25, 10, 0, *[10] * 5))
    _, line = load(tmp_path, [found(1, settings=settings)])
    outputs = [(o.mode, o.hold_s) for o in line.stations[0].outputs[:3]]
    assert outputs == [("pulse", 2.5), (None, None), ("pulse", None)]


def test_a_module_with_other_settings_is_left_out_and_named(tmp_path: Path) -> None:
    """A line has one baud rate and protocol: those of most modules; the switches say the rest."""
    stranger = found(9, DO100, baud=9600, protocols=RTU)
    text, line = load(tmp_path, [stranger, found(1), found(2)])
    assert [s.address for s in line.stations] == [1, 2]
    assert "a DO100 at address 9 answers" in text
    assert "modbus-rtu at 9600 baud" in text
    assert "DIP switches to 10010 01 1" in text


def test_a_clash_is_named(tmp_path: Path) -> None:
    """A clash is mentioned in the written configuration, as a missing module."""
    clash = Clash(7, 19200, LineProtocol.WISCO, ("44 49",), damaged=3, asked=3)
    text, line = load(tmp_path, [found(1)], "/dev/ttyUSB0", clash)
    assert [s.address for s in line.stations] == [1]
    assert "Address 7 answers garbled" in text


@pytest.mark.parametrize(
    ("port", "written"),
    [
        ("tcp://10.0.0.5:4196", "tcp://10.0.0.5:4196"),
        ("/dev/serial/by-id/usb-FTDI #1", "/dev/serial/by-id/usb-FTDI #1"),
        ("/dev/it's", "/dev/it's"),
    ],
)
def test_a_port_is_written_as_it_was_given(tmp_path: Path, port: str, written: str) -> None:
    """With quotes where YAML needs them."""
    assert load(tmp_path, [found(1)], port)[1].port == written


def test_a_relative_port_is_made_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The daemon runs in another folder."""
    monkeypatch.chdir(tmp_path)
    assert load(tmp_path, [found(1)], "port")[1].port == str(tmp_path / "port")


def test_a_number_that_may_change_comes_with_advice(tmp_path: Path) -> None:
    """/dev/ttyUSB0 may be another adapter tomorrow."""
    assert "/dev/serial/by-id/" in load(tmp_path, [found(1)], "/dev/ttyUSB0")[0]
    assert "/dev/serial/by-id/" not in load(tmp_path, [found(1)], "/dev/rs485")[0]
