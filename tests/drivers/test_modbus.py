from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import replies
from support.frames import all_ways

from bridge.drivers.driver import SettingsDriver
from bridge.drivers.modbus import ModbusDriver
from bridge.errors import RefusedError
from bridge.model import DIO100, DO100, LineProtocol, ModuleType, OutputSettings

RTU, ASCII = LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII
BUILD: dict[LineProtocol, Callable[..., bytes]] = {RTU: replies.rtu, ASCII: replies.ascii_frame}


def described(driver: SettingsDriver) -> tuple[int, ModuleType, bool]:
    """Return the fields of a driver; the type checker proves that it is one."""
    return driver.address, driver.module, driver.protected


def body_of(frame: bytes) -> bytes:
    """The PDU of an RTU request."""
    return frame[1:-2]


@pytest.mark.parametrize("framing", [RTU, ASCII])
def test_it_is_a_settings_driver_with_protection(framing: LineProtocol) -> None:
    """Replies carry station and checksum, so that one of them can be believed."""
    assert described(ModbusDriver(31, DO100, framing)) == (31, DO100, True)


@pytest.mark.parametrize("framing", [RTU, ASCII])
@pytest.mark.parametrize("module", [DIO100, DO100])
def test_reads_have_the_width_of_the_module(framing: LineProtocol, module: ModuleType) -> None:
    """16 inputs, and as many outputs as the module has, from address 0."""
    driver, build = ModbusDriver(5, module, framing), BUILD[framing]
    assert driver.read_inputs.frame == build(5, 2, 0, 0, 0, 16)
    assert driver.read_outputs.frame == build(5, 1, 0, 0, 0, module.outputs)
    assert all_ways(driver.read_inputs, build(5, 2, 2, 0xAB, 0x9E)) == 0x9EAB
    if module is DIO100:
        assert all_ways(driver.read_outputs, build(5, 1, 1, 0xD2)) == 0xD2
    else:
        assert all_ways(driver.read_outputs, build(5, 1, 2, 0x6A, 0xD5)) == 0xD56A


@pytest.mark.parametrize("framing", [RTU, ASCII])
def test_a_do100_refuses_to_read_inputs(framing: LineProtocol) -> None:
    """The input read of a DO100 can be sent: the refusal identifies the model."""
    with pytest.raises(RefusedError):
        all_ways(ModbusDriver(5, DO100, framing).read_inputs, BUILD[framing](5, 0x82, 1))


def test_wisco_is_no_framing() -> None:
    """A mistaken protocol is told instead of framed as one of the others."""
    with pytest.raises(ValueError, match="wisco is no Modbus framing"):
        ModbusDriver(1, DIO100, LineProtocol.WISCO)


@pytest.mark.parametrize(
    ("mask", "values", "current", "pdu"),
    [
        # One bit: function 05, and nothing else is touched.
        (0x08, 0x08, 0x00, "05 00 03 FF 00"),
        (0x08, 0x00, 0xFF, "05 00 03 00 00"),
        (0x08, 0xF7, 0xFF, "05 00 03 00 00"),
        (0x01, 0x01, 0x00, "05 00 00 FF 00"),
        (0x80, 0x80, 0x00, "05 00 07 FF 00"),
        # More: function 15 from the lowest to the highest, gaps as they are.
        (0xFF, 0x72, 0x00, "0F 00 00 00 08 01 72"),
        (0x11, 0x10, 0x0A, "0F 00 00 00 05 01 1A"),
        (0x90, 0x80, 0x60, "0F 00 04 00 04 01 0E"),
        (0x03, 0x03, 0xF0, "0F 00 00 00 02 01 03"),
        (0xC0, 0x40, 0xFF, "0F 00 06 00 02 01 01"),
    ],
)
def test_a_write_is_one_coil_or_a_range(mask: int, values: int, current: int, pdu: str) -> None:
    """One frame for one write, whichever outputs it names."""
    body = bytes.fromhex(pdu)
    for framing, build in BUILD.items():
        request = ModbusDriver(5, DIO100, framing).write_outputs(mask, values, current)
        assert request.frame == build(5, *body)
        all_ways(request, build(5, *body[:5]))


@given(mask=st.integers(1, 0xFFFF), values=st.integers(0, 0xFFFF), current=st.integers(0, 0xFFFF))
def test_a_write_changes_the_mask_alone(mask: int, values: int, current: int) -> None:
    """Played on the outputs as they are, a frame changes what the mask names and nothing else."""
    pdu = body_of(ModbusDriver(5, DO100, RTU).write_outputs(mask, values, current).frame)
    address = int.from_bytes(pdu[1:3], "big")
    if pdu[0] == 5:
        count, bits = 1, int(pdu[3] == 0xFF)
    else:
        count, bits = int.from_bytes(pdu[3:5], "big"), int.from_bytes(pdu[6:], "little")
    written = ((1 << count) - 1) << address
    assert current & ~written | bits << address == current & ~mask | values & mask


@pytest.mark.parametrize(
    ("module", "mask", "values"),
    [(DIO100, 0, 0), (DIO100, 0x100, 0x100), (DIO100, 1, 0x100), (DO100, 0x10000, 0)],
)
def test_writes_stay_inside_the_module(module: ModuleType, mask: int, values: int) -> None:
    """An empty mask or a channel that the module lacks is a ValueError."""
    with pytest.raises(ValueError, match=r"mask|values"):
        ModbusDriver(1, module, RTU).write_outputs(mask, values, 0)


@pytest.mark.parametrize("framing", [RTU, ASCII])
@pytest.mark.parametrize("module", [DIO100, DO100])
def test_settings_are_one_read(framing: LineProtocol, module: ModuleType) -> None:
    """Mode and all hold times come in one function 03."""
    driver, build = ModbusDriver(5, module, framing), BUILD[framing]
    assert driver.read_settings.frame == build(5, 3, 0, 0, 0, 1 + module.outputs)
    holds = tuple(range(1, 1 + module.outputs))
    words = [0, 0x81, *(byte for hold in holds for byte in (0, hold))]
    reply = build(5, 3, 2 + 2 * module.outputs, *words)
    assert all_ways(driver.read_settings, reply) == OutputSettings(pulse=0x81, hold_ds=holds)
    assert driver.read_settings.reply_chars == len(reply)


def test_the_high_mode_byte_counts_on_a_do100_alone() -> None:
    """On a DIO100 it is "don't care"."""
    small, large = (ModbusDriver(1, module, RTU).read_settings for module in (DIO100, DO100))
    assert all_ways(small, replies.rtu(1, 3, 18, 0xAB, 0x81, *(0, 5) * 8)).pulse == 0x81
    assert all_ways(large, replies.rtu(1, 3, 34, 0xAB, 0x81, *(0, 5) * 16)).pulse == 0xAB81


def test_a_strange_hold_time_is_told_as_it_is() -> None:
    """An EEPROM cell can hold anything: it is read, not judged."""
    holds = (0, 0, 0xFF, 0xFF, 1, 0, *(0, 5) * 5)
    settings = all_ways(
        ModbusDriver(1, DIO100, RTU).read_settings, replies.rtu(1, 3, 18, 0, 0, *holds)
    )
    assert settings.hold_ds == (0, 0xFFFF, 0x100, 5, 5, 5, 5, 5)


@pytest.mark.parametrize("framing", [RTU, ASCII])
def test_settings_are_written_one_register_at_a_time(framing: LineProtocol) -> None:
    """Mode is register 40001, the hold time of output n the n-th after it."""
    driver, build = ModbusDriver(5, DO100, framing), BUILD[framing]
    assert driver.write_modes(0x8001).frame == build(5, 6, 0, 0, 0x80, 0x01)
    assert driver.write_modes(0).frame == build(5, 6, 0, 0, 0, 0)
    assert driver.write_hold(1, 25).frame == build(5, 6, 0, 1, 0, 25)
    assert driver.write_hold(16, 255).frame == build(5, 6, 0, 16, 0, 255)
    all_ways(driver.write_hold(1, 25), build(5, 6, 0, 1, 0, 25))


@pytest.mark.parametrize("hold_ds", [-1, 0, 256, 65536])
def test_hold_times_run_from_1_to_255(hold_ds: int) -> None:
    """0.1 to 25.5 seconds, as the module has it."""
    with pytest.raises(ValueError, match="hold time"):
        ModbusDriver(1, DIO100, RTU).write_hold(1, hold_ds)


@pytest.mark.parametrize(("module", "output"), [(DIO100, 0), (DIO100, 9), (DO100, 17)])
def test_hold_times_belong_to_outputs(module: ModuleType, output: int) -> None:
    """An output that the module lacks has no register."""
    with pytest.raises(ValueError, match="output"):
        ModbusDriver(1, module, RTU).write_hold(output, 5)


@pytest.mark.parametrize(("module", "pulse"), [(DIO100, 0x100), (DO100, 0x10000), (DO100, -1)])
def test_modes_stay_inside_the_module(module: ModuleType, pulse: int) -> None:
    """A bit of an output that the module lacks is a ValueError."""
    with pytest.raises(ValueError, match="pulse"):
        ModbusDriver(1, module, RTU).write_modes(pulse)
