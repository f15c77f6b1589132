"""Splits the bytes on the line into request frames, as the receivers of modules do."""

from typing import Protocol

from bridge.model import LineProtocol
from bridge.simulator import modbus

# A frame ends after 3.5 characters of silence (docs/protocol.md section 3), but a pseudo-terminal
# or a network delivers bytes in bursts: a shorter pause than this is not a silence.
LEAST_SILENCE_S = 0.02
LONGEST_TEXT_FRAME = 1024  # the longest request, a WEE of 255 bytes, has 526 characters
LONGEST_RTU_FRAME = 256
RTU_LENGTHS = {1: 8, 2: 8, 3: 8, 5: 8, 6: 8}
RTU_LISTS = (15, 16)  # their length stands in the seventh byte
RTU_COUNT_AT = 6


class Framer(Protocol):
    """The interface of a framer: bytes in, whole frames out."""

    @property
    def waiting(self) -> bool:
        """Return whether bytes are held that only a silence can end."""

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the frames that they complete."""

    def silence(self) -> list[bytes]:
        """Handle a silence; return the frame that it ends."""

    def address(self, frame: bytes) -> int | None:
        """Return the station that a frame addresses; None if it cannot be read."""


class TextFramer:
    """Switch 8 ON: `#` to CR is a Wisco frame, `:` to CR LF a Modbus ASCII frame."""

    waiting = False  # a start character begins a new frame, so silence has no meaning

    def __init__(self) -> None:
        self._held = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the frames that they complete."""
        return [frame for byte in data if (frame := self._take(byte))]

    def _take(self, byte: int) -> bytes:
        if byte in b"#:":
            self._held = bytearray([byte])
        elif self._held:
            self._held.append(byte)
        end = b"\r\n" if self._held[:1] == b":" else b"\r"
        if self._held.endswith(end):
            return self._cut()
        if len(self._held) > LONGEST_TEXT_FRAME:
            self._cut()
        return b""

    def _cut(self) -> bytes:
        frame, self._held = bytes(self._held), bytearray()
        return frame

    def silence(self) -> list[bytes]:
        """Return nothing: text frames do not end by silence."""
        return []

    def address(self, frame: bytes) -> int | None:
        """Return the station: in both kinds of frame the two hex digits after the first byte."""
        try:
            return int(frame[1:3], 16)
        except ValueError:
            return None


class RtuFramer:
    """Switch 8 OFF: a frame ends by silence, or with the CRC of a whole request."""

    def __init__(self) -> None:
        self._held = b""

    @property
    def waiting(self) -> bool:
        """Return whether bytes are held that only a silence can end."""
        return bool(self._held)

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the frames that they complete."""
        self._held += data
        frames = []
        while (size := _rtu_length(self._held)) and modbus.is_rtu(self._held[:size]):
            frames.append(self._held[:size])
            self._held = self._held[size:]
        # Endless bytes without a pause are not a frame.
        self._held = self._held[: LONGEST_RTU_FRAME + 1]
        return frames

    def silence(self) -> list[bytes]:
        """Return the held bytes if their CRC is right; else drop them as noise."""
        frame, self._held = self._held, b""
        return [frame] if modbus.is_rtu(frame) and len(frame) <= LONGEST_RTU_FRAME else []

    def address(self, frame: bytes) -> int | None:
        """Return the first byte."""
        return frame[0]


def _rtu_length(held: bytes) -> int:
    """Return the length of the request that `held` begins with; 0 if it is not known yet."""
    if len(held) < min(RTU_LENGTHS.values()):
        return 0
    function = held[1]
    lists = len("AFSSCCNCC") + held[RTU_COUNT_AT] if function in RTU_LISTS else 0
    size = RTU_LENGTHS.get(function, lists)
    return size if len(held) >= size else 0


def framer_for(protocol: LineProtocol) -> Framer:
    """Return the framer for DIP switch 8 of the modules (docs/protocol.md section 1)."""
    return RtuFramer() if protocol is LineProtocol.MODBUS_RTU else TextFramer()
