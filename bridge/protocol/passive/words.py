"""Describes frames in words, for a person who watches a line.

See docs/protocol.md sections 2 and 3.
"""

from collections.abc import Callable

from bridge.model import channels_of
from bridge.protocol.checksum import wisco_checksum
from bridge.protocol.modbus import EXCEPTION_BYTES, EXCEPTION_FLAG, EXCEPTION_NAMES, words
from bridge.protocol.wisco import ERROR_NAMES

_READ_WORDS = {1: "outputs", 2: "inputs", 3: "registers", 4: "input registers"}
_BIT_READS = (1, 2)
_FUNCTION_AND_TWO_WORDS = 5
_FIRST_REGISTER = 40001
_FIRST = {1: 1, 2: 1, 3: _FIRST_REGISTER, 4: 30001}  # as references are counted
_COIL_ON = 0xFF00
_ERROR = "ERR="
_PARTS = {"DI>": "inputs", "DO>": "outputs"}
_BINARY_CHARS = (8, 16)
_HEX_CHARS = (2, 4)


# --- Modbus ---


def modbus_request(pdu: bytes) -> str:
    """Return a request to a module in words."""
    function = pdu[0]
    if len(pdu) < _FUNCTION_AND_TWO_WORDS:
        return _strange(pdu)
    first, value = words(pdu[1:5])
    if function in _READ_WORDS:
        return f"read {_span(function, first, value)}"
    if function in _WRITES:
        return _WRITES[function](first, value, pdu[6:])
    return _strange(pdu)


def modbus_reply(pdu: bytes, asked: bytes | None) -> str:
    """Return the reply of a module in words; `asked` is the request, if it was heard."""
    function = pdu[0]
    if len(pdu) < EXCEPTION_BYTES:
        return _strange(pdu)
    if function & EXCEPTION_FLAG:
        return f"refused: {EXCEPTION_NAMES.get(pdu[1], 'unknown exception')}"
    if function in _BIT_READS:
        first, count = words(asked[1:5]) if asked else (0, 8 * len(pdu[2:]))
        bits = int.from_bytes(pdu[2:], "little") & ((1 << count) - 1)
        return f"{_READ_WORDS[function]} {_on(bits << first)}"
    if function in _READ_WORDS:
        return f"{_READ_WORDS[function]} = {', '.join(map(str, words(pdu[2:])))}"
    return f"done: {modbus_request(asked)}" if asked else f"done: {pdu.hex(' ').upper()}"


def _span(function: int, first: int, count: int) -> str:
    return f"{_READ_WORDS[function]} {_range(first + _FIRST[function], count)}"


def _coil(first: int, value: int, _: bytes) -> str:
    return f"output {first + 1} {'ON' if value == _COIL_ON else 'OFF'}"


def _one_register(first: int, value: int, _: bytes) -> str:
    return f"{_register(first)} = {value}"


def _coils(first: int, count: int, content: bytes) -> str:
    bits = int.from_bytes(content, "little") & ((1 << count) - 1)
    return f"outputs {_range(first + 1, count)}: {_on(bits << first)}"


def _registers(first: int, count: int, content: bytes) -> str:
    values = ", ".join(map(str, words(content)))
    return f"registers {_range(_FIRST_REGISTER + first, count)} = {values}"


_WRITES: dict[int, Callable[[int, int, bytes], str]] = {
    0x05: _coil,
    0x06: _one_register,
    0x0F: _coils,
    0x10: _registers,
}


def _range(first: int, count: int) -> str:
    return f"{first}-{first + count - 1}" if count > 1 else f"{first}"


def _register(address: int) -> str:
    what = f"hold time of output {address}" if address else "output modes"
    return f"register {_FIRST_REGISTER + address} ({what})"


def _strange(pdu: bytes) -> str:
    return f"function {pdu[0]:02X}h: {pdu[1:].hex(' ').upper() or 'no data'}"


def _on(bits: int) -> str:
    channels = ", ".join(map(str, channels_of(bits)))
    return f"ON: {channels}" if channels else "all OFF"


# --- Wisco ---


def wisco_request(command: str) -> str:
    """Return a request to a module in words."""
    simple = {
        "RDI": "read inputs",
        "RDIH": "read inputs",
        "RDO": "read outputs",
        "RDOH": "read outputs",
    }
    if command in simple:
        return simple[command]
    try:
        if command.startswith("WDOX"):
            return _masked(command.removeprefix("WDOX"))
        if command.startswith("WDO"):
            return _named(command.removeprefix("WDO"))
        if command.startswith("REE"):
            return f"read EEPROM {command[4:8]}h, {int(command[8:12], 16)} bytes"
        if command.startswith("WEE"):
            return f"write EEPROM {command[4:8]}h: {bytes.fromhex(command[10:-2]).hex(' ').upper()}"
    except ValueError:
        pass  # malformed: shown as it is
    return f"unknown command {command}"


def wisco_reply(kind: str, body: str) -> str:
    """Return the reply of a module in words."""
    if kind == _ERROR:
        codes = {str(code): name for code, name in ERROR_NAMES.items()}
        return f"refused: {codes.get(body, 'no such code')}"
    if body == "OK":
        return "done"
    if kind == "EE>":
        return f"EEPROM: {_grouped(body[:-2])}"
    return f"{_PARTS[kind]} {_on(_bits(body))}" if wisco_fault(kind, body) is None else body


def wisco_fault(kind: str, body: str) -> str | None:
    """Return what is wrong with the form of a reply; None: nothing."""
    if kind == _ERROR:
        return None if body in map(str, ERROR_NAMES) else "no such error code"
    if body == "OK" and kind != "DI>":
        return None
    try:
        return _eeprom_fault(body) if kind == "EE>" else _bits_fault(body)
    except ValueError:
        return "not in the form of any reply"


def _eeprom_fault(body: str) -> str | None:
    *data, checksum = bytes.fromhex(body)
    due = wisco_checksum(bytes(data))
    return None if checksum == due else f"checksum {checksum:02X} where {due:02X} is due"


def _bits_fault(body: str) -> str | None:
    _bits(body)
    return None


def _bits(body: str) -> int:
    if len(body) in _BINARY_CHARS:
        return int(body, 2)
    if len(body) in _HEX_CHARS:
        return int(body, 16)
    raise ValueError(body)


def _masked(arguments: str) -> str:
    mask, values = (int(part, 16) for part in arguments.split(","))
    return _switched([(output, values >> (output - 1) & 1 == 1) for output in channels_of(mask)])


def _named(arguments: str) -> str:
    channels, values = arguments.split(",")
    pairs = zip(channels, values, strict=True)
    return _switched([(int(channel), value == "1") for channel, value in pairs])


def _switched(orders: list[tuple[int, bool]]) -> str:
    return "outputs " + ", ".join(f"{output} {'ON' if on else 'OFF'}" for output, on in orders)


def _grouped(digits: str) -> str:
    return " ".join(digits[at : at + 2] for at in range(0, len(digits), 2))
