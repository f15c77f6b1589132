"""A module played by pymodbus on a pseudo-terminal: an opinion on Modbus that is not ours."""

import asyncio
import os
import select
import threading
import time
import tty
from typing import Self

from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerType
from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

from bridge.model import LineProtocol, ModuleType

_FRAMERS = {
    LineProtocol.MODBUS_RTU: FramerType.RTU,
    LineProtocol.MODBUS_ASCII: FramerType.ASCII,
}
_PATIENCE_S = 10.0
READ_INPUTS_FUNCTION = 2
COIL_FUNCTIONS = (1, 5, 15)


class PymodbusModule:
    """One module that answers in a thread of its own, from `start` to `stop`."""

    def __init__(
        self, address: int, module: ModuleType, framing: LineProtocol, inputs: int
    ) -> None:
        self._station = address
        self._module = module
        self._framing = framing
        self._inputs = inputs
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._ready = threading.Event()
        self._stopped = asyncio.Event()
        self._failure: Exception | None = None
        self._ours = self._theirs = -1

    def __enter__(self) -> Self:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._ours)
        tty.setraw(self._theirs)
        self._thread.start()
        assert self._ready.wait(_PATIENCE_S)
        if self._failure:
            raise self._failure
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stopped.set)
        self._thread.join(_PATIENCE_S)
        assert not self._thread.is_alive()
        os.close(self._ours)
        os.close(self._theirs)

    def write(self, data: bytes) -> None:
        """Puts bytes on the line."""
        os.write(self._ours, data)

    def read(self, count: int) -> bytes:
        """Returns exactly `count` bytes, or what came within a generous deadline."""
        data = b""
        deadline = time.monotonic() + _PATIENCE_S
        while len(data) < count and (left := deadline - time.monotonic()) > 0:
            if select.select([self._ours], [], [], left)[0]:
                data += os.read(self._ours, count - len(data))
        return data

    def waiting(self) -> bytes:
        """Returns what has come and was not asked for."""
        return os.read(self._ours, 1000) if select.select([self._ours], [], [], 0)[0] else b""

    def _serve(self) -> None:
        try:
            self._loop.run_until_complete(self._run())
        except Exception as error:  # noqa: BLE001  # `__enter__` raises it again
            self._failure = error
        finally:
            self._ready.set()
            self._loop.close()

    async def _run(self) -> None:
        server = ModbusSerialServer(
            self._device(),
            framer=_FRAMERS[self._framing],
            port=os.ttyname(self._theirs),
            baudrate=57600,
            ignore_missing_devices=True,
        )
        await server.serve_forever(background=True)
        self._ready.set()
        await self._stopped.wait()
        await server.shutdown()  # type: ignore[no-untyped-call]  # pymodbus leaves it untyped
        # The transport closes its descriptor in the next turns of the loop.
        for _ in range(3):
            await asyncio.sleep(0)

    def _device(self) -> SimDevice:
        inputs = [bool(self._inputs >> bit & 1) for bit in range(16)]
        registers = [0, *([5] * self._module.outputs)]
        return SimDevice(
            id=self._station,
            simdata=(
                [SimData(0, values=[False] * 16, datatype=DataType.BITS)],
                [SimData(0, values=inputs, datatype=DataType.BITS)],
                [SimData(0, values=registers, datatype=DataType.REGISTERS)],
                [SimData(0, values=0, datatype=DataType.REGISTERS)],
            ),
            action=self._check,
        )

    async def _check(
        self,
        function: int,
        _start: int,
        address: int,
        _words: int,
        _registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        # pymodbus keeps bits in words of 16: what the module lacks is refused here.
        if function == READ_INPUTS_FUNCTION and not self._module.inputs:
            return ExcCodes.ILLEGAL_FUNCTION
        last = address + len(values or [0])
        if function in COIL_FUNCTIONS and last > self._module.outputs:
            return ExcCodes.ILLEGAL_ADDRESS
        return None
