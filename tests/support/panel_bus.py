"""A bus on a simulated line, as a commissioning command opens one."""

from collections.abc import Iterator
from contextlib import contextmanager

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.transport.bus import Bus
from bridge.transport.opener import open_port
from bridge.transport.timing import LineTiming, rtu_silence_s


@contextmanager
def bus_on(line: SimulatedLine, timeout_s: float = 2.0) -> Iterator[Bus]:
    """Opens the line's port for the time of the block. A loaded machine gets its time."""
    rtu = line.protocol is LineProtocol.MODBUS_RTU
    silence_s = rtu_silence_s(line.baud) if rtu else 0.0
    timing = LineTiming(line.baud, 0.002, silence_s, silence_s, fixed_timeout_s=timeout_s)
    port = open_port(line.port, line.baud)
    try:
        yield Bus(port, timing, late_window_s=0.0)
    finally:
        port.close()
