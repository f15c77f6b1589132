"""A simulated line with a second port on which everything that passes can be listened to."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from bridge.simulator.pty import PtyEndpoint

TAP = "tap"


@contextmanager
def tapped_line(
    directory: Path,
    protocol: LineProtocol,
    *modules: SimulatedModule,
    baud: int = 19200,
    paced: bool = True,
) -> Iterator[SimulatedLine]:
    """Its tap is `directory`/tap."""
    tap = PtyEndpoint(directory / TAP, baud=baud)
    with SimulatedLine(protocol, baud, modules, tap=tap, paced=paced) as line:
        yield line
