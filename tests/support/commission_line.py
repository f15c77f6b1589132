"""Commissioning commands on a simulated line, in this process."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from bridge.cli import main as cli
from bridge.model import DIO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

STATION = 13


@dataclass(frozen=True, slots=True)
class Done:
    """The exit status of a command, and its output."""

    status: int
    out: str
    err: str

    @property
    def complaint(self) -> str:
        """The one line on stderr of a command that failed."""
        assert self.out == ""
        assert self.err.count("\n") == 1, self.err
        return self.err


class Laptop:
    """Runs commands as a person would type them, with `--port` and `--station` of the line."""

    def __init__(self, capsys: pytest.CaptureFixture[str], line: SimulatedLine) -> None:
        self.line = line
        self._capsys = capsys

    def on_station(self, command: str, action: str, *words: str) -> Done:
        """Runs a command on station 13 of the line."""
        flags = ("--port", self.line.port, "--station", f"{STATION}")
        protocol = ("--protocol", self.line.protocol, "--baud", f"{self.line.baud}")
        return self.run(command, action, *words, *flags, *protocol)

    def run(self, *words: str) -> Done:
        """Runs any command line."""
        try:
            status = cli.main(words)
        except SystemExit as end:
            status = int(end.code or 0)
        told = self._capsys.readouterr()
        return Done(status, told.out, told.err)


def line_of_one(protocol: LineProtocol) -> SimulatedLine:
    """One DIO100 at station 13; bytes take no time."""
    modules = [SimulatedModule(DIO100, STATION)]
    return SimulatedLine(protocol, 57600, modules, paced=False, turnaround_s=0.0)


def config_of(directory: Path, line: SimulatedLine) -> Path:
    """A configuration that names the module `garage`."""
    path = directory / "config.yaml"
    path.write_text(
        f"mqtt: {{host: localhost}}\nstate_dir: {directory}\nlines:\n"
        f"  - id: main\n    port: {line.port}\n    baud: {line.baud}\n"
        f"    protocol: {line.protocol}\n"
        f"    stations: [{{address: {STATION}, model: DIO100, id: garage}}]\n"
    )
    return path
