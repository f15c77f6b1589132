"""A simulated line for commands that talk to one module, with a configuration that names it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

BAUD = 57600
GARAGE, PUMPS = 1, 2


@contextmanager
def one_panel(
    directory: Path, protocol: LineProtocol = LineProtocol.WISCO
) -> Iterator[tuple[SimulatedLine, Path]]:
    """A DIO100 `garage` at station 1 and a DO100 `pumps` at station 2, and the file that says so.

    `garage` has input 2 inverted, input 16 left out, output 1 named and output 8 for reading.
    """
    modules = [SimulatedModule(DIO100, GARAGE), SimulatedModule(DO100, PUMPS)]
    with SimulatedLine(protocol, BAUD, modules) as line:
        path = directory / "config.yaml"
        path.write_text(
            # The commands lock the base topic, and other tests run beside this one.
            f"mqtt: {{base_topic: panel-{os.getpid()}}}\n"
            "lines:\n"
            f"  - {{id: main, port: {line.port}, baud: {BAUD}, protocol: {protocol}, timeout: 1s,\n"
            "     late_window: 10ms,\n"
            "     stations: [\n"
            "       {address: 1, model: DIO100, id: garage,\n"
            "        inputs: {2: {invert: true}, 16: false},\n"
            "        outputs: {1: {name: Lamp}, 8: {read_only: true}}},\n"
            "       {address: 2, model: DO100, id: pumps}]}\n"
        )
        yield line, path


def flags(line: SimulatedLine, address: int) -> list[str]:
    """The flags that name a module of the line without a configuration."""
    where = ["--port", line.port, "--station", str(address), "--baud", str(BAUD)]
    return [*where, "--protocol", line.protocol.value]
