"""Cuts what comes down the line into request frames, as the modules' receivers do."""

from typing import Protocol

from bridge.model import LineProtocol
from bridge.simulator import modbus

# A frame is over after 3.5 characters of silence (docs/protocol.md section 3), but bytes come
# through a pseudo-terminal or a network in gusts: no less than this is taken for silence.
LEAST_SILENCE_S = 0.02
LONGEST_TEXT_FRAME = 1024  # the longest request, a WEE of 255 bytes, has 526 characters
LONGEST_RTU_FRAME = 256
RTU_LENGTHS = {1: 8, 2: 8, 3: 8, 5: 8, 6: 8}
RTU_LISTS = (15, 16)  # their length stands in the seventh byte
RTU_COUNT_AT = 6


class Framer(Protocol):
    """Bytes in, whole frames out."""

    @property
    def waiting(self) -> bool:
        """Return whether bytes are held that only silence can end."""
        ...

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the frames that they complete."""
        ...

    def silence(self) -> list[bytes]:
        """Take note of a silence, and return the frame that it ended."""
        ...

    def station(self, frame: bytes) -> int | None:
        """Return the station that a frame calls, or None where that cannot be read."""
        ...


class TextFramer:
    """Switch 8 ON: `#` to CR is a Wisco frame, `:` to CR LF a Modbus ASCII frame."""

    waiting = False  # a start character begins anew, silence means nothing

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
        """Return nothing ends by silence here."""
        return []

    def station(self, frame: bytes) -> int | None:
        """Both kinds of frame name the station in the two hex digits after their first byte."""
        try:
            return int(frame[1:3], 16)
        except ValueError:
            return None


class RtuFramer:
    """Switch 8 OFF: frames end by silence, or as soon as a whole request with its CRC is there."""

    def __init__(self) -> None:
        self._held = b""

    @property
    def waiting(self) -> bool:
        """Return whether bytes are held that only silence can end."""
        return bool(self._held)

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the frames that they complete."""
        self._held += data
        frames = []
        while (size := _rtu_length(self._held)) and modbus.is_rtu(self._held[:size]):
            frames.append(self._held[:size])
            self._held = self._held[size:]
        # Babble without a pause is no frame, however much of it comes.
        self._held = self._held[: LONGEST_RTU_FRAME + 1]
        return frames

    def silence(self) -> list[bytes]:
        """Return what is held is a frame if its CRC says so, else noise: a receiver starts anew."""
        frame, self._held = self._held, b""
        return [frame] if modbus.is_rtu(frame) and len(frame) <= LONGEST_RTU_FRAME else []

    def station(self, frame: bytes) -> int | None:
        """Return the first byte."""
        return frame[0]


def _rtu_length(held: bytes) -> int:
    """Length of the request that `held` begins with; 0 while it is not whole or not known."""
    if len(held) < min(RTU_LENGTHS.values()):
        return 0
    function = held[1]
    lists = len("AFSSCCNCC") + held[RTU_COUNT_AT] if function in RTU_LISTS else 0
    size = RTU_LENGTHS.get(function, lists)
    return size if len(held) >= size else 0


def framer_for(protocol: LineProtocol) -> Framer:
    """DIP switch 8 of the modules of a line (docs/protocol.md section 1)."""
    return RtuFramer() if protocol is LineProtocol.MODBUS_RTU else TextFramer()
