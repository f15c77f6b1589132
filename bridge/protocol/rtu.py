"""Modbus RTU: station, PDU, CRC. A frame has no terminator, so it is found by its CRC."""

from dataclasses import dataclass, field
from typing import Generic, TypeVar

from bridge.errors import BadReplyError
from bridge.protocol.checksum import crc16
from bridge.protocol.expected import Expected
from bridge.protocol.modbus import EXCEPTION_BYTES, EXCEPTION_FLAG, Pdu, modbus_address

T = TypeVar("T")

NOISE_BYTES = 8  # before a reply: a line driver that switches makes one or two
_AROUND_BYTES = 3  # station before the PDU, CRC after it
_EXCEPTION_FRAME_BYTES = EXCEPTION_BYTES + _AROUND_BYTES
_HEAD_BYTES = 3  # station, function and byte count: with these it is hardly noise
_COUNTED = frozenset({0x01, 0x02, 0x03})  # replies that tell their length in the third byte
_ECHOES = frozenset({0x05, 0x06, 0x0F, 0x10})  # replies of one length
_ECHO_FRAME_BYTES = 5 + _AROUND_BYTES


@dataclass(frozen=True, slots=True)
class RtuRequest(Generic[T]):
    """A PDU to one station, 1-31, in an RTU frame."""

    address: int
    pdu: Pdu[T]
    frame: bytes = field(init=False)
    reply_chars: int = field(init=False)
    _expected: Expected = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        address_byte = bytes([modbus_address(self.address)])
        reply_chars = self.pdu.reply_bytes + _AROUND_BYTES
        yes = address_byte + self.pdu.head
        no = address_byte + self.pdu.refusal_head
        object.__setattr__(self, "frame", _with_crc(address_byte + self.pdu.data))
        object.__setattr__(self, "reply_chars", reply_chars)
        expected = Expected(yes, reply_chars, no, _EXCEPTION_FRAME_BYTES)
        object.__setattr__(self, "_expected", expected)

    def missing(self, buffer: bytes) -> int:
        """See `Request`."""
        # As a rule nothing is there yet, then the head of our reply, then all of it.
        yes, left = self._expected.yes, self.reply_chars - len(buffer)
        if not buffer:
            return self._expected.no_chars
        if left > 0 and len(yes) >= _HEAD_BYTES and buffer.startswith(yes):
            return left
        if self._is_plain_yes(buffer):
            return 0
        _, due = self._find(buffer)
        # The reply of another station may be shorter than ours.
        strangers = _frame_bytes(buffer) - len(buffer)
        return min(due, strangers) if strangers > 0 else due

    def decode(self, buffer: bytes) -> T | None:
        """See `Request`."""
        if self._is_plain_yes(buffer):
            return self.pdu.value(buffer[len(self._expected.yes) : -2])
        frame, due = self._find(buffer)
        if frame:
            return self._judge(frame, buffer)
        if due:
            return None
        raise BadReplyError(f"no valid frame from station {self.address}", buffer)

    def _is_plain_yes(self, buffer: bytes) -> bool:
        # Nearly every poll gets exactly this, so it is tried first.
        return (
            len(buffer) == self.reply_chars
            and buffer.startswith(self._expected.yes)
            and not crc16(buffer)
        )

    def _find(self, buffer: bytes) -> tuple[bytes, int]:
        """Return the first valid frame of any station, or the number of missing bytes of ours.

        Return neither when there is more noise than allowed and no reply of ours has begun.
        """
        due = 0
        for offset in range(min(len(buffer), NOISE_BYTES) + 1):
            rest = buffer[offset:]
            length = _frame_bytes(rest)
            if 0 < length <= len(rest) and not crc16(rest[:length]):
                return rest[:length], 0
            left = self._expected.left(rest)
            if left > 0:
                due = min(due or left, left)
                if len(rest) >= _HEAD_BYTES:
                    break  # our reply is arriving: its content is not searched for frames
        return b"", due

    def _judge(self, frame: bytes, buffer: bytes) -> T:
        if frame[0] != self.address:
            raise BadReplyError(f"station {frame[0]} answered for station {self.address}", buffer)
        try:
            return self.pdu.read(frame[1:-2])
        except ValueError as error:
            raise BadReplyError(str(error), buffer) from None


def _with_crc(data: bytes) -> bytes:
    return data + crc16(data).to_bytes(2, "little")


def _frame_bytes(begun: bytes) -> int:
    """Return the length that a reply frame gives itself; 0 if it cannot be determined."""
    if len(begun) < _HEAD_BYTES:
        return 0
    _, function, count = begun[:_HEAD_BYTES]
    if function & EXCEPTION_FLAG:
        return _EXCEPTION_FRAME_BYTES
    if function in _COUNTED:
        return _EXCEPTION_FRAME_BYTES + count
    return _ECHO_FRAME_BYTES if function in _ECHOES else 0
