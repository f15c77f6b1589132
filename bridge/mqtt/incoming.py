"""Limits the size of messages from the broker while they are received."""

from collections.abc import Callable
from typing import Final

# Sent in CONNECT with MQTT 5. MQTT 3.1.1 cannot say it, and a broker may ignore it. Our own largest
# messages are announcements of devices, about 30 KiB.
MOST_PACKET_BYTES: Final = 256 * 1024
# The part of a longer payload that is kept: more than any reader accepts, so a command is refused
# because of its length (`strict_json.MOST_BYTES`), and shown.
KEPT_BYTES: Final = 8192

_PUBLISH = 0x30
_MOST_LENGTH_BYTES = 4
_MOST_TOPIC_BYTES = 2 + 65_535 + 2  # length, topic, message id
_CHUNK_BYTES = 65_536
_CHUNKS_AT_ONCE = 32  # then other work has its turn


class IncomingGuard:
    """Passes on the bytes of the broker, and shortens messages that are too long.

    It is read like a socket: first the fixed header, byte by byte, then the rest. A message that is
    too long comes out with the first bytes of its payload. So it is answered like any other: a
    message with QoS 1 is acknowledged, and a command gets its verdict.

    Attributes:
        cut_bytes: The original length of the present packet if it was shortened, else 0.
    """

    def __init__(self, receive: Callable[[int], bytes], *, has_properties: bool) -> None:
        """Create it; `receive` reads the socket, or raises BlockingIOError if nothing came."""
        self.cut_bytes = 0
        self._receive = receive
        self._has_properties = has_properties
        self._header = bytearray()  # of the packet that begins
        self._body_bytes = 0  # missing bytes of a packet that is passed on
        self._cut_rest_bytes = 0  # missing bytes of a packet that is shortened
        self._head = bytearray()  # its first bytes
        self._ready = b""  # to be passed on before more is read

    def read(self, count: int) -> bytes:
        """Return at most `count` bytes; none: the connection was closed.

        Raises:
            BlockingIOError: Nothing can be passed on at the moment.
            ConnectionError: The bytes are not MQTT.
        """
        if not self._ready:
            if self._body_bytes:
                data = self._receive(min(count, self._body_bytes))
                self._body_bytes -= len(data)
                return data
            if not (self._skip() if self._cut_rest_bytes else self._begin()):
                return b""
        given, self._ready = self._ready[:count], self._ready[count:]
        return given

    def _begin(self) -> bool:
        """Read the fixed header of a packet; return False if the connection was closed."""
        while not _is_whole(self._header):
            byte = self._receive(1)
            if not byte:
                return False
            self._header += byte
        header, self._header = bytes(self._header), bytearray()
        length, _ = _number(header, 1)
        self.cut_bytes = 0
        if len(header) + length <= MOST_PACKET_BYTES:
            self._ready, self._body_bytes = header, length
            return True
        if header[0] & 0xF0 != _PUBLISH:
            raise ConnectionError(f"the broker sent a packet of {length} bytes that is no message")
        self.cut_bytes = len(header) + length
        self._head = bytearray(header[:1])
        self._cut_rest_bytes = length
        return self._skip()

    def _skip(self) -> bool:
        """Drop bytes of a message that is too long; return False if the connection was closed."""
        for _ in range(_CHUNKS_AT_ONCE):
            data = self._receive(min(_CHUNK_BYTES, self._cut_rest_bytes))
            if not data:
                return False
            self._cut_rest_bytes -= len(data)
            self._head += data[: _MOST_TOPIC_BYTES + 2 * KEPT_BYTES - len(self._head)]
            if not self._cut_rest_bytes:
                self._ready, self._head = self._shortened(), bytearray()
                return True
        raise BlockingIOError

    def _shortened(self) -> bytes:
        """Return a whole packet made of the first bytes of one that was too long."""
        first, head = self._head[0], bytes(self._head[1:])
        rest = 2 + int.from_bytes(head[:2]) + (2 if first & 0x06 else 0)
        body, payload = head[:rest], head[rest : rest + KEPT_BYTES]
        if self._has_properties:
            length, at = _number(head, rest)
            end = at + length
            # Properties that are too long are left out.
            body = head[:end] if length <= KEPT_BYTES else body + b"\0"
            payload = head[end : end + KEPT_BYTES].ljust(KEPT_BYTES, b"\0")
        body += payload
        return bytes([first]) + as_number(len(body)) + body


def _is_whole(header: bytearray) -> bool:
    if len(header) > 1 + _MOST_LENGTH_BYTES:
        raise ConnectionError("what the broker sent is no MQTT: the length of a packet has no end")
    return len(header) > 1 and not header[-1] & 0x80


def _number(data: bytes, at: int) -> tuple[int, int]:
    """Return a number of variable length, and the position after it."""
    value = shift = 0
    for place in range(at, min(at + _MOST_LENGTH_BYTES, len(data))):
        value |= (data[place] & 0x7F) << shift
        shift += 7
        if not data[place] & 0x80:
            return value, place + 1
    return value, at + _MOST_LENGTH_BYTES


def as_number(value: int) -> bytes:
    """Return a number in variable length."""
    data = bytearray()
    while True:
        value, low = divmod(value, 128)
        data.append(low | (0x80 if value else 0))
        if not value:
            return bytes(data)
