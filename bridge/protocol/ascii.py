"""Modbus ASCII: `:`, then station, PDU and LRC in upper-case hex, then CR LF."""

import re
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from bridge.errors import BadReplyError
from bridge.protocol.checks import NOISE_CHARS, hex_digits
from bridge.protocol.checksum import lrc
from bridge.protocol.expected import Expected
from bridge.protocol.modbus import EXCEPTION_BYTES, Pdu, modbus_address

T = TypeVar("T")

_START = b":"
_AROUND_BYTES = 2  # station before the PDU, LRC after it
_AROUND_CHARS = 3  # the colon, CR and LF
_SHORTEST_BYTES = EXCEPTION_BYTES + _AROUND_BYTES
# A colon always starts a new frame: it cannot be inside a frame.
_REPLY = re.compile(rb":([^:\n]*)\n")


@dataclass(frozen=True, slots=True)
class AsciiRequest(Generic[T]):
    """A PDU to one station, 1-31, in an ASCII frame."""

    address: int
    pdu: Pdu[T]
    frame: bytes = field(init=False)
    reply_chars: int = field(init=False)
    _expected: Expected = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        address_byte = bytes([modbus_address(self.address)])
        reply_chars = _chars(self.pdu.reply_bytes)
        yes = _START + _hex(address_byte + self.pdu.head)
        no = _START + _hex(address_byte + self.pdu.refusal_head)
        object.__setattr__(self, "frame", _with_lrc(address_byte + self.pdu.data))
        object.__setattr__(self, "reply_chars", reply_chars)
        expected = Expected(yes, reply_chars, no, _chars(EXCEPTION_BYTES))
        object.__setattr__(self, "_expected", expected)

    def missing(self, buffer: bytes) -> int:
        """See `Request`."""
        if _REPLY.search(buffer) or self._is_flooded(buffer):
            return 0
        begun = buffer[buffer.rfind(_START) :] if _START in buffer else b""
        # A frame that is not for us may have any length: only its LF is certain to come.
        return max(1, self._expected.left(begun))

    def decode(self, buffer: bytes) -> T | None:
        """See `Request`."""
        if found := _REPLY.search(buffer):
            return self._judge(found[1], buffer)
        if self._is_flooded(buffer):
            raise BadReplyError(f"{len(buffer)} bytes without a reply", buffer)
        return None

    def _judge(self, text: bytes, buffer: bytes) -> T:
        try:
            address, reply = _open(text)
            if address == self.address:
                return self.pdu.read(reply)
        except ValueError as error:
            raise BadReplyError(str(error), buffer) from None
        raise BadReplyError(f"station {address} answered for station {self.address}", buffer)

    def _is_flooded(self, buffer: bytes) -> bool:
        return len(buffer) > self.reply_chars + NOISE_CHARS


def _open(text: bytes) -> tuple[int, bytes]:
    """Return station and PDU of the text between colon and LF, or raise ValueError."""
    if not text.endswith(b"\r"):
        raise ValueError("no CR before the LF")
    data = bytes.fromhex(hex_digits(text[:-1]).decode("ascii"))
    if len(data) < _SHORTEST_BYTES:
        raise ValueError(f"{len(data)} bytes are too few for a frame")
    if lrc(data):
        raise ValueError(f"LRC {data[-1]:02X} came where {lrc(data[:-1]):02X} is due")
    return data[0], data[1:-1]


def _hex(data: bytes) -> bytes:
    return data.hex().upper().encode("ascii")


def _with_lrc(data: bytes) -> bytes:
    return _START + _hex(data + bytes([lrc(data)])) + b"\r\n"


def _chars(pdu_bytes: int) -> int:
    return 2 * (pdu_bytes + _AROUND_BYTES) + _AROUND_CHARS
