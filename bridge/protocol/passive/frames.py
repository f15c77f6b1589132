"""Finds frames of all three protocols in the bytes on a line, both requests and replies.

The protocol is recognised frame by frame. Text frames start with a character that no valid RTU
frame of these modules starts with. A CRC fits by chance once in 65,536 times.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from bridge.model import LineProtocol
from bridge.protocol.checks import HEX
from bridge.protocol.checksum import crc16, lrc
from bridge.protocol.modbus import EXCEPTION_FLAG

_LAST_MODBUS_STATION = 247  # devices of other makers on the same line
_SHORTEST_RTU = 4
_LONGEST_RTU = 256
# The longest frame of the modules: the reply to a REE of all 2,048 bytes.
_LONGEST_HELD = 3 + 2 * 2048 + 2 + 1
_REQUEST_BYTES = 8
_READS = frozenset({0x01, 0x02, 0x03, 0x04})
_SINGLE_WRITES = frozenset({0x05, 0x06})
_LIST_WRITES = frozenset({0x0F, 0x10})
_LIST_COUNT_AT = 6
_EXCEPTION_BYTES = 5

_TEXT = re.compile(
    rb"#(?P<station>[0-9A-F]{2})(?P<command>[!-~]+)\r"
    rb"|(?P<kind>DI>|DO>|EE>|ERR=)(?P<body>[!-~]*)\r"
    rb"|:(?P<hex>[0-9A-Fa-f]*)\r\n"
)


@dataclass(frozen=True, slots=True)
class WiscoAsked:
    """A Wisco request: the address and the command."""

    data: bytes
    address: int
    command: str


@dataclass(frozen=True, slots=True)
class WiscoSaid:
    """A Wisco reply. It does not carry the address of its module."""

    data: bytes
    kind: str
    body: str


@dataclass(frozen=True, slots=True)
class ModbusPassed:
    """A Modbus frame with a valid checksum. It may be a request or a reply."""

    data: bytes
    address: int
    pdu: bytes
    protocol: LineProtocol


@dataclass(frozen=True, slots=True)
class StrayBytes:
    """Bytes that are not a frame, and a guess at what they are."""

    data: bytes
    reason: str


Piece = WiscoAsked | WiscoSaid | ModbusPassed | StrayBytes


class FrameFinder:
    """Finds frames in a stream of bytes. Noise is returned when a frame or a silence follows it."""

    def __init__(self) -> None:
        self._held = b""

    @property
    def holding(self) -> bool:
        """Return whether bytes wait for the end of their frame."""
        return bool(self._held)

    def feed(self, data: bytes) -> list[Piece]:
        """Return the pieces that these bytes complete."""
        self._held += data
        pieces = list(self._complete())
        if len(self._held) > _LONGEST_HELD:
            pieces += self.fall_silent()
        return pieces

    def fall_silent(self) -> list[Piece]:
        """Return what is held: after a silence it will not be completed."""
        held, self._held = self._held, b""
        if not held:
            return []
        if _SHORTEST_RTU <= len(held) <= _LONGEST_RTU and not crc16(held):
            return [_rtu(held)]  # a function that these modules do not have
        return [StrayBytes(held, _likeness(held))]

    def _complete(self) -> Iterator[Piece]:
        while found := _first_frame(self._held):
            offset, piece = found
            if offset:
                yield StrayBytes(self._held[:offset], _likeness(self._held[:offset]))
            yield piece
            self._held = self._held[offset + len(piece.data) :]


def _first_frame(held: bytes) -> tuple[int, Piece] | None:
    text = _TEXT.search(held)
    end = text.start() if text else len(held)
    for offset in range(end):
        if frame := _rtu_at(held, offset):
            return offset, _rtu(frame)
    return (end, _text(text)) if text else None


def _rtu_at(held: bytes, offset: int) -> bytes:
    """Return the RTU frame that begins at `offset`, as far as its length can be determined."""
    if len(held) - offset < _EXCEPTION_BYTES or held[offset] > _LAST_MODBUS_STATION:
        return b""
    for size in _sizes(held[offset : offset + _LIST_COUNT_AT + 1]):
        frame = held[offset : offset + size]
        if len(frame) == size and not crc16(frame):
            return frame
    return b""


def _sizes(head: bytes) -> tuple[int, ...]:
    """Return the possible lengths of a frame with these first bytes: request, and reply."""
    function = head[1]
    if function & EXCEPTION_FLAG:
        return (_EXCEPTION_BYTES,)
    if function in _READS:
        return (_REQUEST_BYTES, _EXCEPTION_BYTES + head[2])
    if function in _SINGLE_WRITES:
        return (_REQUEST_BYTES,)
    if function in _LIST_WRITES and len(head) > _LIST_COUNT_AT:
        return (_REQUEST_BYTES, _REQUEST_BYTES + 1 + head[_LIST_COUNT_AT])
    return ()


def _rtu(frame: bytes) -> ModbusPassed:
    return ModbusPassed(frame, frame[0], frame[1:-2], LineProtocol.MODBUS_RTU)


def _text(found: re.Match[bytes]) -> Piece:
    data = found[0]
    if found["command"]:
        return WiscoAsked(data, int(found["station"], 16), found["command"].decode("ascii"))
    if found["kind"]:
        return WiscoSaid(data, found["kind"].decode("ascii"), found["body"].decode("ascii"))
    return _ascii(data, found["hex"])


def _ascii(data: bytes, digits: bytes) -> Piece:
    if digits.translate(None, HEX):
        return StrayBytes(data, "Modbus ASCII with lower-case digits: the modules write upper case")
    if len(digits) % 2 or len(digits) < 2 * len("AFL"):
        return StrayBytes(data, "Modbus ASCII of a length that no frame has")
    content = bytes.fromhex(digits.decode("ascii"))
    if lrc(content):
        due = lrc(content[:-1])
        return StrayBytes(data, f"Modbus ASCII with LRC {content[-1]:02X} where {due:02X} is due")
    return ModbusPassed(data, content[0], content[1:-1], LineProtocol.MODBUS_ASCII)


def _likeness(data: bytes) -> str:
    """Return a guess at what a piece of noise was."""
    if data[:1] in {b"#", b":"} or data.startswith((b"DI>", b"DO>", b"EE>", b"ERR=")):
        return "a text frame that broke off or was damaged"
    functions = _READS | _SINGLE_WRITES | _LIST_WRITES
    known = len(data) >= _SHORTEST_RTU and data[1] & ~EXCEPTION_FLAG in functions
    if known and data[0] <= _LAST_MODBUS_STATION:
        return f"an RTU frame of station {data[0]} with a wrong CRC, or a part of one"
    return "noise"
