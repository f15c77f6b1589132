"""Advice on a configuration: `check` and `run` give it, and go on."""

import logging
from pathlib import Path

import pytest

from bridge import __version__
from bridge.cli import run
from bridge.cli.main import main
from bridge.daemon.app import RunResult


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """Two lines on numbered adapters."""
    path = tmp_path / "config.yaml"
    lines = "".join(
        f"  - {{id: {name}, port: {port}, baud: 9600, protocol: wisco,\n"
        f"     stations: [{{address: 1, model: DIO100}}]}}\n"
        for name, port in (("a", "/dev/ttyUSB0"), ("b", "/dev/ttyUSB1"))
    )
    path.write_text(f"state_dir: {tmp_path}\nlines:\n{lines}")
    return path


def test_check_warns_and_prints_the_plan(
    config: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line each on stderr; the configuration is valid all the same."""
    monkeypatch.setattr("bridge.cli.main.configure_logging", lambda *_: None)
    assert main(["-c", str(config), "--log-level", "error", "check"]) == 0
    captured = capsys.readouterr()
    first, second = captured.err.splitlines()
    assert first.startswith("warning: line a: /dev/ttyUSB0 ")
    assert second.startswith("warning: line b: /dev/ttyUSB1 ")
    assert captured.out.startswith("line a: cycle ")


def test_check_warns_of_buttons_that_are_read_too_seldom(
    config: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plan tells it: the file alone does not say how fast a line is."""
    button = "model: DIO100, inputs: {3: {gestures: {long: 200ms, double: 50ms}}}"
    config.write_text(config.read_text().replace("model: DIO100", button, 1))
    monkeypatch.setattr("bridge.cli.main.configure_logging", lambda *_: None)
    assert main(["-c", str(config), "--log-level", "error", "check"]) == 0
    warnings = capsys.readouterr().err.splitlines()
    assert warnings[-1].startswith("warning: station a_01: input 3 is read every ")


def test_run_warns_and_runs(
    config: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The log has a line each, and one for the start and the stop."""

    class StoppedApp:
        def __init__(self, *_: object, **__: object) -> None:
            pass

        def run(self, _: object) -> RunResult:
            return RunResult.STOPPED

    monkeypatch.setattr(run, "App", StoppedApp)
    monkeypatch.setattr(run.RunSignals, "install", lambda _: None)
    monkeypatch.setattr("bridge.cli.main.configure_logging", lambda *_: None)
    with caplog.at_level(logging.INFO):
        assert main(["-c", str(config), "run"]) == 0
    assert [record.getMessage() for record in caplog.records][2:] == [
        f"wisco2mqtt {__version__} starts with {config}; its lines: a, b",
        "stopped",
    ]
    assert [record.getMessage()[:25] for record in caplog.records][:2] == [
        "line a: /dev/ttyUSB0 may ",
        "line b: /dev/ttyUSB1 may ",
    ]
