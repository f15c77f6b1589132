"""The output of a scan."""

import pytest

from bridge.cli.views.scan_report import Spent, report
from bridge.commission.findings import Findings, Found, Noise
from bridge.model import DIO100, DO100, LineProtocol, ModuleType

TOOK = Spent(2.0, 1.5)


def scanned(*found: Found) -> Findings:
    """Return the findings of a scan."""
    findings = Findings()
    findings.found = list(found)
    return findings


def found(address: int, model: ModuleType, baud: int, *, damaged: int = 0) -> Found:
    """A module."""
    return Found(address, model, baud, (LineProtocol.MODBUS_RTU,), None, damaged, asked=6)


def test_modules_that_make_no_line_with_the_others_are_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A line has one baud rate."""
    modules = found(1, DIO100, 9600), found(2, DIO100, 9600), found(3, DO100, 4800)
    report("/dev/rs485", scanned(*modules), TOOK, as_json=False)
    assert "1 module of them not at 9600 baud in modbus-rtu" in capsys.readouterr().err


def test_damaged_replies_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    """Damaged replies of a module that was found are mentioned."""
    report("/dev/rs485", scanned(found(13, DO100, 57600, damaged=1)), TOOK, as_json=False)
    out = capsys.readouterr().out
    assert out == "13  DO100  57600  modbus-rtu  10110 11 0  1 of 6 replies damaged\n"


def test_noise_is_told_three_times(capsys: pytest.CaptureFixture[str]) -> None:
    """The rest is counted."""
    scan = scanned(found(1, DIO100, 9600))
    scan.noises = [Noise(None, 9600, LineProtocol.WISCO, f"0{n}") for n in range(5)]
    report("/dev/rs485", scan, TOOK, as_json=False)
    err = capsys.readouterr().err
    assert err.count("noise at 9600 baud in wisco, no module asked: 0") == 3
    assert err.endswith("noise 2 times more\n")
