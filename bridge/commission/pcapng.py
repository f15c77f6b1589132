"""Writes pcapng for Wireshark: one packet for each frame, link type RTAC serial (250).

pcap has no link type for serial Modbus. Wireshark can pass RTAC serial on to its Modbus RTU
dissector with `tshark -d rtacser.data,mbrtu`.
"""

import struct
from typing import BinaryIO

_SECTION, _INTERFACE, _PACKET = 0x0A0D0D0A, 0x00000001, 0x00000006  # block types
_BYTE_ORDER = 0x1A2B3C4D
_LENGTH_UNKNOWN = -1
_RTAC_SERIAL = 250
_MICROSECONDS = 1_000_000  # per second: the default unit of pcapng
_COMMENT, _FLAGS = 1, 2  # options
_INBOUND, _OUTBOUND = 1, 2
# Event types of the RTAC header: sent, and received, seen from the master.
_SENT, _RECEIVED = 0x01, 0x02
_AROUND_BLOCK = 12  # type and length, and the length again


class PcapngWriter:
    """Appends frames to an open file, which it does not own."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def begin(self, interface: str) -> None:
        """Write the head of the file; `interface` names the port."""
        self._block(_SECTION, struct.pack("<IHHq", _BYTE_ORDER, 1, 0, _LENGTH_UNKNOWN))
        name = _option(2, interface.encode()) + _option(0, b"")
        self._block(_INTERFACE, struct.pack("<HHI", _RTAC_SERIAL, 0, 0) + name)

    def frame(self, at_s: float, data: bytes, *, reply: bool, comment: str | None) -> None:
        """Write one frame. `at_s` counts from 1970; a comment says what is wrong with the frame."""
        micros = round(at_s * _MICROSECONDS)
        event = _RECEIVED if reply else _SENT
        # RTAC: seconds, microseconds, event, control lines, two bytes of footer.
        seconds, rest = divmod(micros, _MICROSECONDS)
        packet = struct.pack(">IIBBH", seconds & 0xFFFFFFFF, rest, event, 0, 0) + data
        lengths = struct.pack("<II", len(packet), len(packet))
        head = struct.pack("<III", 0, micros >> 32, micros & 0xFFFFFFFF) + lengths
        flags = _option(_FLAGS, struct.pack("<I", _INBOUND if reply else _OUTBOUND))
        note = _option(_COMMENT, comment.encode()) if comment else b""
        self._block(_PACKET, head + _padded(packet) + note + flags + _option(0, b""))

    def _block(self, kind: int, body: bytes) -> None:
        size = len(body) + _AROUND_BLOCK
        self._file.write(struct.pack("<II", kind, size) + body + struct.pack("<I", size))


def _option(code: int, value: bytes) -> bytes:
    return struct.pack("<HH", code, len(value)) + _padded(value)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
