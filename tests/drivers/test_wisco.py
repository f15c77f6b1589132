import pytest
from support.frames import all_ways

from bridge.drivers.driver import Driver
from bridge.drivers.wisco import WiscoDriver
from bridge.errors import BadReplyError, RefusedError
from bridge.model import DIO100, DO100, ModuleType


def described(driver: Driver) -> tuple[int, ModuleType, bool]:
    """Return the fields of a driver; the type checker proves that it is one."""
    return driver.address, driver.module, driver.protected


def test_it_is_a_driver_without_protection() -> None:
    """Wisco replies carry neither station nor checksum: the line must read changes twice."""
    assert described(WiscoDriver(0, DIO100)) == (0, DIO100, False)


def test_reads_are_the_hex_commands() -> None:
    """RDIH and RDOH, with the width of the module."""
    small, large = WiscoDriver(7, DIO100), WiscoDriver(7, DO100)
    assert small.read_inputs.frame == b"#07RDIH\r"
    assert small.read_outputs.frame == large.read_outputs.frame == b"#07RDOH\r"
    assert all_ways(small.read_inputs, b"DI>9EAB\r") == 0x9EAB
    assert all_ways(small.read_outputs, b"DO>D2\r") == 0xD2
    assert all_ways(large.read_outputs, b"DO>D56A\r") == 0xD56A


@pytest.mark.parametrize(("module", "reply"), [(DIO100, b"DO>D56A\r"), (DO100, b"DO>D2\r")])
def test_the_other_modules_width_is_a_bad_reply(module: ModuleType, reply: bytes) -> None:
    """A reply with the width of the other model is bad, so it is never read as values."""
    with pytest.raises(BadReplyError, match="characters came where"):
        all_ways(WiscoDriver(1, module).read_outputs, reply)


def test_a_do100_refuses_to_read_inputs() -> None:
    """The input read of a DO100 can be sent: the refusal identifies the model."""
    with pytest.raises(RefusedError):
        all_ways(WiscoDriver(1, DO100).read_inputs, b"ERR=1\r")


@pytest.mark.parametrize(
    ("module", "mask", "values", "current", "frame"),
    [
        (DIO100, 0x04, 0x04, 0x00, b"#0DWDOX04,04\r"),
        (DIO100, 0x73, 0x72, 0x00, b"#0DWDOX73,72\r"),
        (DO100, 0x8B73, 0x8B72, 0x0000, b"#0DWDOX8B73,8B72\r"),
        (DO100, 0x0001, 0x0000, 0xFFFF, b"#0DWDOX0001,0000\r"),
        (DIO100, 0x01, 0x81, 0x40, b"#0DWDOX01,01\r"),
    ],
)
def test_writes_are_masked(
    module: ModuleType, mask: int, values: int, current: int, frame: bytes
) -> None:
    """One WDOX names the mask and its values; what the other outputs are is not in it."""
    request = WiscoDriver(13, module).write_outputs(mask, values, current)
    assert request.frame == frame
    all_ways(request, b"DO>OK\r")


@pytest.mark.parametrize(
    ("module", "mask", "values"),
    [(DIO100, 0, 0), (DIO100, 0x100, 0x100), (DIO100, 1, 0x100), (DO100, 0x10000, 0)],
)
def test_writes_stay_inside_the_module(module: ModuleType, mask: int, values: int) -> None:
    """An empty mask or a channel that the module lacks is a ValueError."""
    with pytest.raises(ValueError, match=r"mask|values"):
        WiscoDriver(1, module).write_outputs(mask, values, 0)


@pytest.mark.parametrize("address", [-1, 32])
def test_stations_run_from_0_to_31(address: int) -> None:
    """A driver for a station that cannot be is never built."""
    with pytest.raises(ValueError, match="station"):
        WiscoDriver(address, DIO100)
