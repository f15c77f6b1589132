"""One station in Modbus frames, RTU or ASCII, with modes and hold times.

See docs/protocol.md section 3.
"""

from typing import TypeVar

from bridge.model import DIO100, HOLD_DS, LineProtocol, ModuleType, OutputSettings
from bridge.protocol.ascii import AsciiRequest
from bridge.protocol.checks import in_range, nonempty_mask, within_width
from bridge.protocol.modbus import (
    Pdu,
    ReadCoils,
    ReadDiscreteInputs,
    ReadHoldingRegisters,
    WriteCoil,
    WriteCoils,
    WriteRegister,
    words,
)
from bridge.protocol.request import Request
from bridge.protocol.rtu import RtuRequest

T = TypeVar("T")

_MODE_ADDRESS = 0  # register 40001; the hold time of output n is at address n


class ModbusDriver:
    """A SettingsDriver in RTU or ASCII frames. Stations 1-31: address 0 is the broadcast."""

    def __init__(self, address: int, module: ModuleType, framing: LineProtocol) -> None:
        if framing is LineProtocol.WISCO:
            raise ValueError(f"{framing} is no Modbus framing")
        self.address = address
        self.module = module
        self.protected = True
        self._framing = framing
        self.read_inputs = self._request(ReadDiscreteInputs(0, DIO100.inputs))
        self.read_outputs = self._request(ReadCoils(0, module.outputs))
        self.read_settings = self._request(ReadSettings(module))

    def write_outputs(self, mask: int, values: int, current: int) -> Request[None]:
        """Return the write of outputs (see `Driver`). A single output is written as one coil."""
        nonempty_mask(mask, self.module.outputs)
        within_width("values", values, self.module.outputs)
        first = (mask & -mask).bit_length() - 1
        count = mask.bit_length() - first
        if count == 1:
            return self._request(WriteCoil(first, bool(values & mask)))
        wanted = (current & ~mask) | (values & mask)
        span = (wanted >> first) & ((1 << count) - 1)
        return self._request(WriteCoils(first, count, span))

    def write_modes(self, pulse: int) -> Request[None]:
        """Return the write of modes (see `SettingsDriver`)."""
        within_width("pulse", pulse, self.module.outputs)
        return self._request(WriteRegister(_MODE_ADDRESS, pulse))

    def write_hold(self, output: int, hold_ds: int) -> Request[None]:
        """Return the write of a hold time (see `SettingsDriver`)."""
        in_range("output", output, 1, self.module.outputs)
        in_range("hold time", hold_ds, HOLD_DS[0], HOLD_DS[-1])
        return self._request(WriteRegister(_MODE_ADDRESS + output, hold_ds))

    def _request(self, pdu: Pdu[T]) -> Request[T]:
        if self._framing is LineProtocol.MODBUS_RTU:
            return RtuRequest(self.address, pdu)
        return AsciiRequest(self.address, pdu)


class ReadSettings(Pdu[OutputSettings]):
    """One read of the mode register and all hold times of a module."""

    __slots__ = ()

    def __init__(self, module: ModuleType) -> None:
        registers = ReadHoldingRegisters(_MODE_ADDRESS, 1 + module.outputs)
        super().__init__(registers.data, registers.head, registers.reply_bytes)

    def value(self, body: bytes) -> OutputSettings:
        """Return what the registers hold, including a hold time outside 1-255."""
        mode, *hold_ds = words(body)
        # The high byte of the mode register of a DIO100 has no meaning (docs/protocol.md section
        # 3).
        return OutputSettings(pulse=mode & ((1 << len(hold_ds)) - 1), hold_ds=tuple(hold_ds))
