"""The abilities of a DIO100 or DO100, as requests in each protocol."""

from bridge.config.schema import LineConfig, StationConfig
from bridge.drivers.driver import Driver, SettingsDriver
from bridge.drivers.modbus import ModbusDriver
from bridge.drivers.wisco import WiscoDriver
from bridge.model import LineProtocol, ModuleType

__all__ = ["driver_for", "settings_driver_for"]


def driver_for(protocol: LineProtocol, address: int, module: ModuleType) -> Driver:
    """Return the driver for the protocol of a line."""
    if protocol is LineProtocol.WISCO:
        return WiscoDriver(address, module)
    return ModbusDriver(address, module, protocol)


def settings_driver_for(line: LineConfig, config: StationConfig) -> SettingsDriver | None:
    """Return the driver for modes and hold times; None if they cannot be reached."""
    if not line.asks_modbus(config):
        return None
    return ModbusDriver(config.address, config.model, line.protocol.in_modbus)
