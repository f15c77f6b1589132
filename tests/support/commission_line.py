"""Commissioning commands on a simulated line, in this process."""

from pathlib import Path

import pytest
from support.laptop import Ended, ended_of

from bridge.model import DIO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

STATION = 13


class Laptop:
    """Runs commands as a person would type them, on the station `garage` of a configuration."""

    def __init__(
        self, capsys: pytest.CaptureFixture[str], line: SimulatedLine, config: Path
    ) -> None:
        self.line = line
        self.config = config
        self._capsys = capsys

    def on_station(self, command: str, action: str, *words: str) -> Ended:
        """Runs a command on it."""
        return self.run(command, action, "garage", *words, "--config", str(self.config))

    def run(self, *words: str) -> Ended:
        """Runs any command line."""
        return ended_of(self._capsys, *words)


def line_of_one(protocol: LineProtocol) -> SimulatedLine:
    """One DIO100 at station 13; bytes take no time."""
    modules = [SimulatedModule(DIO100, STATION)]
    return SimulatedLine(protocol, 57600, modules, paced=False, turnaround_s=0.0)


def config_of(directory: Path, line: SimulatedLine) -> Path:
    """A configuration that names the module `garage`; replies are not late on its line."""
    path = directory / "config.yaml"
    path.write_text(
        f"mqtt: {{host: localhost}}\nstate_dir: {directory}\nlines:\n"
        f"  - id: main\n    port: {line.port}\n    baud: {line.baud}\n"
        f"    protocol: {line.protocol}\n    late_window: 10ms\n"
        f"    stations: [{{address: {STATION}, model: DIO100, id: garage}}]\n"
    )
    return path
