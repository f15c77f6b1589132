"""Other people's masters on the simulated lines: mbpoll (libmodbus) over RTU, pymodbus over ASCII.

A JUnit report tells on how many cases they agree, as the property `agreed` of each test.
"""

import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator

import pytest
from pymodbus.client import ModbusSerialClient
from pymodbus.framer import FramerType

from bridge.model import DIO100, DO100
from bridge.simulator import SimulatedLine, SimulatedModule

COILS, INPUTS, REGISTERS = "0", "1", "4"  # mbpoll's -t
DIO, DO = 1, 13


@pytest.fixture
def agreed(request: pytest.FixtureRequest) -> Callable[[int], None]:
    """Records a count of cases."""
    return lambda count: request.node.user_properties.append(("agreed", count))


@pytest.fixture
def rtu_line() -> Iterator[SimulatedLine]:
    """A DIO100 and a DO100, switch 8 OFF."""
    modules = [SimulatedModule(DIO100, DIO), SimulatedModule(DO100, DO)]
    with SimulatedLine("modbus-rtu", 19200, modules) as line:
        yield line


@pytest.fixture
def ascii_line() -> Iterator[SimulatedLine]:
    """A DIO100 and a DO100, switch 8 ON."""
    modules = [SimulatedModule(DIO100, DIO), SimulatedModule(DO100, DO)]
    with SimulatedLine("modbus-ascii", 57600, modules, turnaround_s=0.001) as line:
        yield line


@pytest.fixture
def mbpoll(rtu_line: SimulatedLine) -> Callable[..., str]:
    """Runs mbpoll once on the RTU line and returns what it prints."""
    program = shutil.which("mbpoll")
    if program is None and os.environ.get("CI") == "true":
        pytest.fail("mbpoll is not installed, and CI must run these tests")
    if program is None:
        pytest.skip("mbpoll is not installed (Debian: apt install mbpoll)")

    def run(address: int, kind: str, start: int, *values: int, count: int = 1) -> str:
        where = ("-a", str(address), "-t", kind, "-r", str(start), "-c", str(count))
        how = ("-m", "rtu", "-b", "19200", "-P", "none", "-1", "-o", "5")
        written = [str(value) for value in values]
        command = (program, *how, *where[: 6 if values else 8], rtu_line.port, *written)
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
        return done.stdout + done.stderr

    return run


def values_in(printed: str) -> list[int]:
    """The values of lines like `[3]: 1`."""
    return [int(value) for value in re.findall(r"^\[\d+\]:\s+(\d+)", printed, re.MULTILINE)]


def bits(value: int, count: int) -> list[int]:
    """Channel 1 first."""
    return [value >> n & 1 for n in range(count)]


def test_mbpoll_reads(
    rtu_line: SimulatedLine, mbpoll: Callable[..., str], agreed: Callable[[int], None]
) -> None:
    """Coils, discrete inputs and holding registers are what the modules have."""
    dio, do = rtu_line.module(DIO), rtu_line.module(DO)
    for channel in (1, 2, 4, 6, 8, 16):
        dio.set_input(channel, True)
    dio.write_outputs(0xFF, 0xD2, b"")
    do.write_outputs(0xFFFF, 0x8B72, b"")
    do.set_mode(16, pulse=True, hold_s=25.5)
    cases = [
        (mbpoll(DIO, INPUTS, 1, count=16), bits(dio.inputs, 16)),
        (mbpoll(DIO, INPUTS, 4, count=3), [1, 0, 1]),
        (mbpoll(DIO, COILS, 1, count=8), bits(0xD2, 8)),
        (mbpoll(DO, COILS, 1, count=16), bits(0x8B72, 16)),
        (mbpoll(DO, COILS, 16), [1]),
        (mbpoll(DO, REGISTERS, 1, count=17), [0x8000, *[10] * 15, 255]),
        (mbpoll(DIO, REGISTERS, 9), [10]),
    ]
    for printed, values in cases:
        assert values_in(printed) == values, printed
    agreed(len(cases))


def test_mbpoll_writes(
    rtu_line: SimulatedLine, mbpoll: Callable[..., str], agreed: Callable[[int], None]
) -> None:
    """One coil, several coils, one register, several registers: FC05, 15, 06, 16."""
    dio, do = rtu_line.module(DIO), rtu_line.module(DO)
    cases = [
        mbpoll(DIO, COILS, 4, 1),
        mbpoll(DO, COILS, 1, *bits(0x8B72, 16)),
        mbpoll(DO, COILS, 16, 0),
        mbpoll(DIO, REGISTERS, 2, 25),
        mbpoll(DO, REGISTERS, 1, 0x8001, 1, 255),
    ]
    for printed in cases:
        assert "Written" in printed, printed
    assert dio.outputs == 0x08
    assert do.outputs == 0x0B72
    assert do.ordered[16, True] == do.ordered[16, False] == 1
    assert dio.settings.hold_ds[0] == 25
    assert do.settings.pulse == 0x8001
    assert do.settings.hold_ds[:3] == (1, 255, 10)
    functions = [entry.data[1] for entry in rtu_line.log if entry.direction == ">"]
    assert functions == [5, 15, 5, 6, 16]
    agreed(len(cases))


def test_mbpoll_sees_refusals(
    rtu_line: SimulatedLine, mbpoll: Callable[..., str], agreed: Callable[[int], None]
) -> None:
    """The program mbpoll understands exceptions 01, 02 and 03, and reports a missing module."""
    cases = [
        (mbpoll(DO, INPUTS, 1), "Illegal function"),
        (mbpoll(DIO, "3", 1), "Illegal function"),
        (mbpoll(DIO, COILS, 9), "Illegal data address"),
        (mbpoll(DIO, REGISTERS, 10), "Illegal data address"),
        (mbpoll(DIO, COILS, 9, 1), "Illegal data address"),
        (mbpoll(DIO, REGISTERS, 2, 256), "Illegal data value"),
        (mbpoll(DIO, REGISTERS, 2, 25, 0), "Illegal data value"),
    ]
    for printed, told in cases:
        assert told in printed, printed
    assert rtu_line.module(DIO).eeprom_writes == 0
    agreed(len(cases))


@pytest.fixture
def client(ascii_line: SimulatedLine) -> Iterator[ModbusSerialClient]:
    """Pymodbus with ASCII framing on the line."""
    client = ModbusSerialClient(
        ascii_line.port, framer=FramerType.ASCII, baudrate=57600, timeout=5, retries=0
    )
    assert client.connect()
    yield client
    client.close()  # type: ignore[no-untyped-call]  # pymodbus leaves it without types


def test_pymodbus_reads(
    ascii_line: SimulatedLine, client: ModbusSerialClient, agreed: Callable[[int], None]
) -> None:
    """Every range of coils and inputs that there is, and the registers."""
    dio = ascii_line.module(DIO)
    dio.write_outputs(0xFF, 0xD2, b"")
    for channel in (1, 2, 4, 6, 8, 16):
        dio.set_input(channel, True)
    count_of_cases = 0
    for start in range(8):
        for count in range(1, 9 - start):
            coils = client.read_coils(start, count=count, device_id=DIO).bits[:count]
            inputs = client.read_discrete_inputs(2 * start, count=count, device_id=DIO).bits[:count]
            assert coils == [bool(bit) for bit in bits(0xD2 >> start, count)]
            assert inputs == [bool(bit) for bit in bits(dio.inputs >> 2 * start, count)]
            count_of_cases += 2
    registers = client.read_holding_registers(0, count=17, device_id=DO).registers
    assert registers == [0, *[10] * 16]
    agreed(count_of_cases + 1)


def test_pymodbus_writes(
    ascii_line: SimulatedLine, client: ModbusSerialClient, agreed: Callable[[int], None]
) -> None:
    """FC05, 06, 15 and 16 do what they say, and their echoes are taken for good."""
    do = ascii_line.module(DO)
    cases = [
        client.write_coil(15, True, device_id=DO),
        client.write_coils(0, [True, False, True], device_id=DO),
        client.write_register(16, 255, device_id=DO),
        client.write_registers(0, [0x0101, 1], device_id=DO),
    ]
    assert not any(reply.isError() for reply in cases)
    assert do.ordered == {(16, True): 1, (1, True): 1, (2, False): 1, (3, True): 1}
    assert do.outputs == 0x8005
    assert do.settings.pulse == 0x0101
    assert do.settings.hold_ds == (1, *[10] * 14, 255)
    agreed(len(cases))


def test_pymodbus_sees_refusals(client: ModbusSerialClient, agreed: Callable[[int], None]) -> None:
    """Exceptions 01, 02 and 03 are understood as what they are."""
    cases = [
        (client.read_discrete_inputs(0, count=1, device_id=DO), 1),
        (client.read_input_registers(0, count=1, device_id=DIO), 1),
        (client.read_coils(8, count=1, device_id=DIO), 2),
        (client.write_coil(16, True, device_id=DO), 2),
        (client.read_holding_registers(0, count=10, device_id=DIO), 2),
        (client.write_register(1, 0, device_id=DIO), 3),
    ]
    for reply, code in cases:
        assert reply.isError()
        assert reply.exception_code == code
    agreed(len(cases))
