"""Our Modbus frames against pymodbus, which was written by others from the same standard."""

from collections.abc import Iterator
from typing import TypeVar

import pytest
from support.pymodbus_module import PymodbusModule

from bridge.drivers.modbus import ModbusDriver
from bridge.errors import RefusedError
from bridge.model import DIO100, DO100, LineProtocol, OutputSettings
from bridge.protocol.request import Request

T = TypeVar("T")

STATION = 13
INPUTS = 0x9EAB
EVERY_MODULE = [
    (framing, module)
    for framing in (LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII)
    for module in (DIO100, DO100)
]


class Peer:
    """One of our drivers, and a pymodbus module that it talks to. Counts the exchanges."""

    def __init__(self, driver: ModbusDriver, port: PymodbusModule) -> None:
        self.driver = driver
        self.exchanges = 0
        self._port = port

    def exchange(self, request: Request[T]) -> T | None:
        """Sends a request and reads exactly its reply, as a bus does."""
        self.exchanges += 1
        self._port.write(request.frame)
        buffer = b""
        while due := request.missing(buffer):
            data = self._port.read(due)
            assert len(data) == due, f"{due - len(data)} bytes are missing after {buffer!r}"
            buffer += data
        assert self._port.waiting() == b""
        return request.decode(buffer)

    def refusal(self, request: Request[object]) -> int:
        """Sends a request that is to be refused, and returns the code."""
        with pytest.raises(RefusedError) as caught:
            self.exchange(request)
        return caught.value.code


@pytest.fixture(params=EVERY_MODULE, ids=lambda case: f"{case[0]}-{case[1].name}")
def peer(request: pytest.FixtureRequest) -> Iterator[Peer]:
    """Both framings with both modules; a report tells how many exchanges a test made."""
    framing, module = request.param
    with PymodbusModule(STATION, module, framing, INPUTS) as port:
        peer = Peer(ModbusDriver(STATION, module, framing), port)
        yield peer
        request.node.user_properties.append(("exchanges", peer.exchanges))
    assert peer.exchanges >= 2


def test_inputs_are_read_or_refused(peer: Peer) -> None:
    """A DIO100's inputs come bit for bit; a DO100 answers with exception 01."""
    if peer.driver.module is DIO100:
        for _ in range(20):
            assert peer.exchange(peer.driver.read_inputs) == INPUTS
    else:
        for _ in range(20):
            assert peer.refusal(peer.driver.read_inputs) == 1


def test_each_output_is_switched_alone(peer: Peer) -> None:
    """Function 05 on each output, ON and OFF, leaves the others as they are."""
    state = peer.exchange(peer.driver.read_outputs)
    assert state == 0
    for values in (0xFFFF, 0):
        for output in range(peer.driver.module.outputs):
            bit = 1 << output
            peer.exchange(peer.driver.write_outputs(bit, values & bit, state))
            state = state & ~bit | values & bit
            assert peer.exchange(peer.driver.read_outputs) == state


def test_every_range_of_outputs_is_switched(peer: Peer) -> None:
    """Function 15 over every range, with all gaps, changes what the mask names alone."""
    outputs = peer.driver.module.outputs
    state = 0
    for low in range(outputs):
        for high in range(low + 1, outputs):
            mask = 1 << low | 1 << high | (0x2492 & ((1 << high) - (1 << low)))
            values = (0x5A5A ^ state) & mask
            peer.exchange(peer.driver.write_outputs(mask, values, state))
            state = state & ~mask | values
            assert peer.exchange(peer.driver.read_outputs) == state


def test_settings_are_written_and_read(peer: Peer) -> None:
    """Mode and hold times go to their registers (function 06) and come back (function 03)."""
    outputs = peer.driver.module.outputs
    assert peer.exchange(peer.driver.read_settings) == OutputSettings(0, (5,) * outputs)
    pulse = 0xA5A5 % (1 << outputs)
    peer.exchange(peer.driver.write_modes(pulse))
    holds = tuple(255 - 15 * output for output in range(outputs))
    for output, hold_ds in enumerate(holds, start=1):
        peer.exchange(peer.driver.write_hold(output, hold_ds))
    assert peer.exchange(peer.driver.read_settings) == OutputSettings(pulse, holds)


@pytest.mark.parametrize("framing", [LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII])
def test_what_a_dio100_lacks_is_refused(framing: LineProtocol) -> None:
    """A driver that takes a DIO100 for a DO100 gets exception 02 for outputs and registers."""
    with PymodbusModule(STATION, DIO100, framing, INPUTS) as port:
        peer = Peer(ModbusDriver(STATION, DO100, framing), port)
        driver = peer.driver
        for output in range(9, 17):
            assert peer.refusal(driver.write_outputs(1 << (output - 1), 0, 0)) == 2
            assert peer.refusal(driver.write_outputs(1 | 1 << (output - 1), 0, 0)) == 2
            assert peer.refusal(driver.write_hold(output, 5)) == 2
        assert peer.refusal(driver.read_settings) == 2
    assert peer.exchanges == 25
