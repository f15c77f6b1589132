"""Modbus PDUs of the modules, without station and framing (docs/protocol.md section 3).

A PDU knows the first bytes of its good reply: for a read the function and the byte count; for a
write the whole reply, because it repeats the request.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, TypeVar

from bridge.errors import RefusedError
from bridge.model import LAST_ADDRESS
from bridge.protocol.checks import in_range, within_width

T = TypeVar("T")

# Station 0 is the broadcast address: every module would obey and no module would answer.
FIRST_ADDRESS = 1
EXCEPTION_FLAG = 0x80
EXCEPTION_BYTES = 2  # of the PDU: function and code
EXCEPTION_NAMES = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
}

_COIL_ON = b"\xff\x00"
_COIL_OFF = b"\x00\x00"
_LAST_ADDRESS = 0xFFFF
_LAST_VALUE = 0xFFFF
# The most that fits into a PDU of 253 bytes (Modbus standard).
_MAX_READ_BITS = 2000
_MAX_READ_REGISTERS = 125
_MAX_WRITE_BITS = 1968


@dataclass(frozen=True, slots=True)
class Pdu(ABC, Generic[T]):
    """One request, and how its reply is read.

    Attributes:
        data: The request as it is sent.
        head: First bytes of the good reply.
        reply_bytes: Length of the good reply.
    """

    data: bytes
    head: bytes
    reply_bytes: int

    @property
    def refusal_head(self) -> bytes:
        """Return the first bytes of a refusal."""
        return bytes([self.data[0] | EXCEPTION_FLAG])

    @abstractmethod
    def value(self, body: bytes) -> T:
        """Return the value from the bytes that follow the head of a good reply."""

    def read(self, reply: bytes) -> T:
        """Return the value of a reply whose station and checksum are right.

        Raises:
            RefusedError: The module refuses.
            ValueError: It is not a reply to this request; the message says why.
        """
        if len(reply) == self.reply_bytes and reply.startswith(self.head):
            return self.value(reply[len(self.head) :])
        if len(reply) == EXCEPTION_BYTES and reply.startswith(self.refusal_head):
            code = reply[1]
            raise RefusedError(code, EXCEPTION_NAMES.get(code, "unknown exception"))
        if reply[0] != self.head[0]:
            raise ValueError(f"function {reply[0]:02X} answered function {self.head[0]:02X}")
        raise ValueError(f"{reply.hex(' ')} does not answer {self.data.hex(' ')}")


class _BitsRead(Pdu[int]):
    """A read of bits: bit 0 of the value is the one at `address`."""

    __slots__ = ()

    def __init__(self, function: int, address: int, count: int) -> None:
        _check_span(address, count, _MAX_READ_BITS)
        size = (count + 7) // 8
        head = bytes([function, size])
        super().__init__(_request(function, address, count), head, len(head) + size)

    def value(self, body: bytes) -> int:
        count = int.from_bytes(self.data[3:5], "big")
        # The padding bits of the last byte are not channels.
        return int.from_bytes(body, "little") & ((1 << count) - 1)


class ReadCoils(_BitsRead):
    """Function 01: outputs."""

    __slots__ = ()

    def __init__(self, address: int, count: int) -> None:
        super().__init__(0x01, address, count)


class ReadDiscreteInputs(_BitsRead):
    """Function 02: inputs. A DO100 refuses it."""

    __slots__ = ()

    def __init__(self, address: int, count: int) -> None:
        super().__init__(0x02, address, count)


class ReadHoldingRegisters(Pdu[tuple[int, ...]]):
    """Function 03: words of the EEPROM."""

    __slots__ = ()

    def __init__(self, address: int, count: int) -> None:
        _check_span(address, count, _MAX_READ_REGISTERS)
        head = bytes([0x03, 2 * count])
        super().__init__(_request(0x03, address, count), head, len(head) + 2 * count)

    def value(self, body: bytes) -> tuple[int, ...]:
        """Return the registers, the one at `address` first."""
        return words(body)


class _WriteRequest(Pdu[None]):
    """A write. The reply repeats function, address, and value or count."""

    __slots__ = ()

    def __init__(self, head: bytes, content: bytes = b"") -> None:
        super().__init__(head + content, head, len(head))

    def value(self, body: bytes) -> None:
        """Return nothing: the reply only repeats the request."""


class WriteCoil(_WriteRequest):
    """Function 05: one output."""

    __slots__ = ()

    def __init__(self, address: int, on: bool) -> None:
        in_range("address", address, 0, _LAST_ADDRESS)
        super().__init__(bytes([0x05]) + _word(address) + (_COIL_ON if on else _COIL_OFF))


class WriteRegister(_WriteRequest):
    """Function 06: one word of the EEPROM, which it wears."""

    __slots__ = ()

    def __init__(self, address: int, value: int) -> None:
        in_range("address", address, 0, _LAST_ADDRESS)
        in_range("value", value, 0, _LAST_VALUE)
        super().__init__(_request(0x06, address, value))


class WriteCoils(_WriteRequest):
    """Function 15: `count` outputs; bit 0 of `values` is the one at `address`."""

    __slots__ = ()

    def __init__(self, address: int, count: int, values: int) -> None:
        _check_span(address, count, _MAX_WRITE_BITS)
        within_width("values", values, count)
        size = (count + 7) // 8
        content = bytes([size]) + values.to_bytes(size, "little")
        super().__init__(_request(0x0F, address, count), content)


def modbus_address(address: int) -> int:
    """Return `address`; raise ValueError if no module can have this address."""
    return in_range("Modbus station", address, FIRST_ADDRESS, LAST_ADDRESS)


def words(data: bytes) -> tuple[int, ...]:
    """Return the 16-bit words in `data`, high byte first."""
    return tuple(int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2))


def _word(value: int) -> bytes:
    return value.to_bytes(2, "big")


def _request(function: int, address: int, value: int) -> bytes:
    return bytes([function]) + _word(address) + _word(value)


def _check_span(address: int, count: int, most: int) -> None:
    in_range("address", address, 0, _LAST_ADDRESS)
    in_range("quantity", count, 1, min(most, _LAST_ADDRESS + 1 - address))
