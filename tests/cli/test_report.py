"""`wisco2mqtt report`: what it takes along."""

import io
from pathlib import Path

import pytest
from support.config_file import file_with
from support.mosquitto import free_port

from bridge.cli import main as cli

SAID = [f"line {n} of the log" for n in range(600)]


def test_the_log_comes_through_a_pipe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As from journalctl: its last 500 lines. What no broker tells is left out."""
    monkeypatch.setattr(cli, "configure_logging", lambda *_: None)
    config, report = tmp_path / "config.yaml", tmp_path / "report.txt"
    config.write_text(file_with(top=f"mqtt: {{port: {free_port()}}}"))
    piped = io.TextIOWrapper(io.BytesIO("\n".join(SAID).encode()))
    monkeypatch.setattr("sys.stdin", piped)
    words = ["report", str(report), "--log", "-", "--for", "1s", "--config", str(config)]
    assert cli.main(words) == 0
    told = report.read_text().splitlines()
    begin = told.index("# | --- log ---") + 1
    assert told[begin : begin + 500] == [f"# | {line}" for line in SAID[-500:]]
    assert "is written" in capsys.readouterr().err
