"""Simulated modules on a line: a second opinion that shares no code with the codecs."""

from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule, Switching
from bridge.simulator.pty import PtyEndpoint
from bridge.simulator.tcp import TcpEndpoint
from bridge.simulator.wire import Direction, WireEntry

__all__ = [
    "Direction",
    "FaultKind",
    "PtyEndpoint",
    "SimulatedLine",
    "SimulatedModule",
    "Switching",
    "TcpEndpoint",
    "WireEntry",
    "is_write",
]
