"""What a DIO100 or DO100 can do, in requests of each protocol."""

from bridge.config.schema import LineConfig, StationConfig
from bridge.drivers.driver import Driver, SettingsDriver
from bridge.drivers.modbus import ModbusDriver
from bridge.drivers.wisco import WiscoDriver
from bridge.model import LineProtocol, ModuleType, Writes

__all__ = ["driver_for", "settings_driver_for"]


def driver_for(protocol: LineProtocol, station: int, module: ModuleType) -> Driver:
    """Returns the driver that speaks what the line speaks."""
    if protocol is LineProtocol.WISCO:
        return WiscoDriver(station, module)
    return ModbusDriver(station, module, protocol)


def settings_driver_for(line: LineConfig, station: StationConfig) -> SettingsDriver | None:
    """Returns the driver that may reach modes and hold times; None: nothing does."""
    if line.protocol is not LineProtocol.WISCO:
        return ModbusDriver(station.address, station.model, line.protocol)
    # Station 0 is Modbus' broadcast address: it is never asked (PROTOCOL.md section 1).
    if line.writes is Writes.WISCO or station.address == 0:
        return None
    return ModbusDriver(station.address, station.model, LineProtocol.MODBUS_ASCII)
