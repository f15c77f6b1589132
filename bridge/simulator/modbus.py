"""Reads and answers Modbus frames as a module does, RTU and ASCII (docs/protocol.md section 3).

Address 0 is the broadcast: writes are carried out, as in the standard, and no module replies, not
even one whose own address is 0.
"""

import struct
from collections.abc import Callable

from bridge.model import HOLD_DS
from bridge.simulator.module import SETTINGS_AT, SimulatedModule

BROADCAST = 0
ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
ILLEGAL_VALUE = 3
DEVICE_FAILURE = 4
INPUTS_OF_ANOTHER = 16  # what a DO100 answers in the dialect `do100-inputs`
ODD_CODE = 16  # what the dialect `odd-codes` adds to the standard ones
COIL_ON, COIL_OFF = 0xFF00, 0x0000
HEX = frozenset(b"0123456789ABCDEF")

# Limits of one frame: from the Modbus application protocol, not from the modules.
MOST_BITS_READ, MOST_BITS_WRITTEN = 2000, 1968
MOST_REGISTERS_READ, MOST_REGISTERS_WRITTEN = 125, 123


class _ModbusRefusalError(Exception):
    """The module does nothing and answers an exception with this code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(code)


# --- frames ---


def answer_rtu(module: SimulatedModule, frame: bytes, *, failing: bool = False) -> bytes | None:
    """Return the answer to an RTU frame; None: for another module, or damaged.

    `failing`: the module does nothing and answers that it has failed.
    """
    reply = _answer(module, frame[:-2], frame, failing) if is_rtu(frame) else None
    return None if reply is None else _seal_rtu(reply)


def answer_ascii(module: SimulatedModule, frame: bytes, *, failing: bool = False) -> bytes | None:
    """Return the answer to an ASCII frame; None: for another module, or damaged.

    `failing`: the module does nothing and answers that it has failed.
    """
    body = ascii_body(frame)
    reply = None if body is None else _answer(module, body, frame, failing)
    return None if reply is None else _seal_ascii(reply)


def is_rtu(frame: bytes) -> bool:
    """Return whether these bytes are a whole RTU frame with the right CRC."""
    return len(frame) >= len("AFCC") and crc(frame[:-2]) == frame[-2:]


def ascii_body(frame: bytes) -> bytes | None:
    """Return address and PDU of a frame from `:` to CR LF; None if it is damaged."""
    digits = frame[1:-2]
    if len(digits) % 2 or len(digits) < len("AAFFLL") or not HEX.issuperset(digits):
        return None
    data = bytes.fromhex(digits.decode("ascii"))
    return data[:-1] if lrc(data[:-1]) == data[-1] else None


def crc(data: bytes) -> bytes:
    """Return the CRC-16 of Modbus, in the order in which it is sent."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


def lrc(data: bytes) -> int:
    """Return the two's complement of the sum of the bytes."""
    return -sum(data) & 0xFF


def _seal_rtu(body: bytes) -> bytes:
    return body + crc(body)


def _seal_ascii(body: bytes) -> bytes:
    return b":" + (body + bytes([lrc(body)])).hex().upper().encode("ascii") + b"\r\n"


# --- what is asked ---


def _answer(module: SimulatedModule, body: bytes, frame: bytes, failing: bool) -> bytes | None:
    address, function, data = body[0], body[1], body[2:]
    if address not in (module.address, BROADCAST):
        return None
    if address == BROADCAST and "no-broadcast" in module.habits:
        return None
    try:
        reply = bytes([function]) + _obey(module, function, data, frame, failing)
    except _ModbusRefusalError as refusal:
        code = refusal.code + ODD_CODE if "odd-codes" in module.habits else refusal.code
        reply = bytes([function | 0x80, code])
    silent = address == BROADCAST and "answers-0" not in module.habits
    return None if silent else bytes([address]) + reply


def _obey(
    module: SimulatedModule, function: int, data: bytes, frame: bytes, failing: bool
) -> bytes:
    if failing:
        raise _ModbusRefusalError(DEVICE_FAILURE)
    if function not in FUNCTIONS:
        raise _ModbusRefusalError(ILLEGAL_FUNCTION)
    if len(data) < 4:  # noqa: PLR2004 - an address and a count or value, two bytes each
        raise _ModbusRefusalError(ILLEGAL_VALUE)
    return FUNCTIONS[function](module, data, frame)


def _read_coils(module: SimulatedModule, data: bytes, _frame: bytes) -> bytes:
    return _read_bits(module.outputs, module.model.outputs, data)


def _read_inputs(module: SimulatedModule, data: bytes, _frame: bytes) -> bytes:
    if not module.model.inputs and "do100-inputs" in module.habits:
        return _read_bits(0, INPUTS_OF_ANOTHER, data)
    if not module.model.inputs:
        raise _ModbusRefusalError(ILLEGAL_FUNCTION)
    return _read_bits(module.inputs, module.model.inputs, data)


def _read_bits(bits: int, channels: int, data: bytes) -> bytes:
    start, count = _range(data, MOST_BITS_READ, channels)
    size = (count + 7) // 8
    wanted = bits >> start & ((1 << count) - 1)
    return bytes([size]) + wanted.to_bytes(size, "little")


def _write_coil(module: SimulatedModule, data: bytes, frame: bytes) -> bytes:
    output, value = _words(data)
    if value not in (COIL_ON, COIL_OFF):
        raise _ModbusRefusalError(ILLEGAL_VALUE)
    if output >= module.model.outputs:
        raise _ModbusRefusalError(ILLEGAL_ADDRESS)
    bit = 1 << output
    module.write_outputs(bit, bit if value == COIL_ON else 0, frame)
    return data


def _write_coils(module: SimulatedModule, data: bytes, frame: bytes) -> bytes:
    start, count = _range(data[:4], MOST_BITS_WRITTEN, module.model.outputs)
    payload = _payload(data, (count + 7) // 8)
    mask = (1 << count) - 1
    module.write_outputs(mask << start, (int.from_bytes(payload, "little") & mask) << start, frame)
    return data[:4]


def _read_registers(module: SimulatedModule, data: bytes, _frame: bytes) -> bytes:
    start, count = _range(data, MOST_REGISTERS_READ, module.registers)
    return bytes([2 * count]) + module.read_eeprom(SETTINGS_AT + 2 * start, 2 * count)


def _write_register(module: SimulatedModule, data: bytes, _frame: bytes) -> bytes:
    register, _ = _words(data)
    if register >= module.registers:
        raise _ModbusRefusalError(ILLEGAL_ADDRESS)
    _store(module, register, data[2:])
    return data


def _write_registers(module: SimulatedModule, data: bytes, _frame: bytes) -> bytes:
    start, count = _range(data[:4], MOST_REGISTERS_WRITTEN, module.registers)
    _store(module, start, _payload(data, 2 * count))
    return data[:4]


def _store(module: SimulatedModule, start: int, values: bytes) -> None:
    """Write registers, all or none. Register 0 is the mode, the others are hold times."""
    for register, (value,) in enumerate(struct.iter_unpack(">H", values), start):
        if register and value not in HOLD_DS:
            raise _ModbusRefusalError(ILLEGAL_VALUE)
    module.write_eeprom(SETTINGS_AT + 2 * start, values)


def _range(data: bytes, most: int, there_are: int) -> tuple[int, int]:
    start, count = _words(data)
    if not 1 <= count <= most:
        raise _ModbusRefusalError(ILLEGAL_VALUE)
    if start + count > there_are:
        raise _ModbusRefusalError(ILLEGAL_ADDRESS)
    return start, count


def _words(data: bytes) -> tuple[int, int]:
    if len(data) != 4:  # noqa: PLR2004 - two words
        raise _ModbusRefusalError(ILLEGAL_VALUE)
    return int.from_bytes(data[:2], "big"), int.from_bytes(data[2:], "big")


def _payload(data: bytes, size: int) -> bytes:
    if data[4:5] != bytes([size]) or len(data) != 4 + 1 + size:
        raise _ModbusRefusalError(ILLEGAL_VALUE)
    return data[5:]


FUNCTIONS: dict[int, Callable[[SimulatedModule, bytes, bytes], bytes]] = {
    1: _read_coils,
    2: _read_inputs,
    3: _read_registers,
    5: _write_coil,
    6: _write_register,
    15: _write_coils,
    16: _write_registers,
}
