"""The table of docs/protocol.md section 5: what each poll costs on the wire."""

import pytest

from bridge.drivers import driver_for
from bridge.model import DIO100, DO100, LineProtocol, ModuleType
from bridge.protocol.request import Request


def cost(request: Request[int]) -> tuple[int, int]:
    """Characters of the request and of its reply."""
    return len(request.frame), request.reply_chars


@pytest.mark.parametrize(
    ("protocol", "inputs", "dio100_outputs", "do100_outputs"),
    [
        (LineProtocol.WISCO, (8, 8), (8, 6), (8, 8)),
        (LineProtocol.MODBUS_RTU, (8, 7), (8, 6), (8, 7)),
        (LineProtocol.MODBUS_ASCII, (17, 15), (17, 13), (17, 15)),
    ],
)
def test_reads_cost_what_the_table_says(
    protocol: LineProtocol,
    inputs: tuple[int, int],
    dio100_outputs: tuple[int, int],
    do100_outputs: tuple[int, int],
) -> None:
    """Each driver's reads are the cheapest of its protocol."""
    assert cost(driver_for(protocol, 1, DIO100).read_inputs) == inputs
    assert cost(driver_for(protocol, 1, DIO100).read_outputs) == dio100_outputs
    assert cost(driver_for(protocol, 1, DO100).read_outputs) == do100_outputs


@pytest.mark.parametrize("protocol", LineProtocol)
@pytest.mark.parametrize("module", [DIO100, DO100])
def test_no_read_waits_for_more_than_a_refusal_has(
    protocol: LineProtocol, module: ModuleType
) -> None:
    """The first read asks for no more than a refusal of that protocol is long."""
    refusal = {"wisco": 6, "modbus-rtu": 5, "modbus-ascii": 11}[protocol]
    driver = driver_for(protocol, 1, module)
    assert {driver.read_inputs.missing(b""), driver.read_outputs.missing(b"")} == {refusal}
