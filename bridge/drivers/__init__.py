"""What a DIO100 or DO100 can do, in requests of each protocol."""

from bridge.drivers.driver import Driver
from bridge.drivers.modbus import ModbusDriver
from bridge.drivers.wisco import WiscoDriver
from bridge.model import LineProtocol, ModuleType

__all__ = ["driver_for"]


def driver_for(protocol: LineProtocol, station: int, module: ModuleType) -> Driver:
    """Returns the driver that speaks what the line speaks."""
    if protocol is LineProtocol.WISCO:
        return WiscoDriver(station, module)
    return ModbusDriver(station, module, protocol)
