import pytest

from bridge.drivers import driver_for
from bridge.drivers.modbus import ModbusDriver
from bridge.drivers.wisco import WiscoDriver
from bridge.model import DIO100, DO100, LineProtocol


@pytest.mark.parametrize(
    ("protocol", "kind", "frame"),
    [
        (LineProtocol.WISCO, WiscoDriver, b"#01RDOH\r"),
        (LineProtocol.MODBUS_RTU, ModbusDriver, bytes.fromhex("01 01 00 00 00 08 3D CC")),
        (LineProtocol.MODBUS_ASCII, ModbusDriver, b":010100000008F6\r\n"),
    ],
)
def test_each_line_protocol_has_its_driver(
    protocol: LineProtocol, kind: type, frame: bytes
) -> None:
    """The driver speaks what the line speaks."""
    driver = driver_for(protocol, 1, DIO100)
    assert isinstance(driver, kind)
    assert driver.read_outputs.frame == frame


@pytest.mark.parametrize("protocol", LineProtocol)
def test_the_station_and_the_module_are_its_own(protocol: LineProtocol) -> None:
    """The driver has the station and the module for which it was built."""
    driver = driver_for(protocol, 31, DO100)
    assert (driver.address, driver.module) == (31, DO100)
