"""Requests are cut out of what comes down the line, whole, in pieces and out of noise."""

import pytest

from bridge.model import LineProtocol
from bridge.simulator.framing import LONGEST_RTU_FRAME, LONGEST_TEXT_FRAME, framer_for
from bridge.simulator.modbus import crc

RTU_REQUESTS = [
    "01 02 00 00 00 10 79 C6",
    "01 05 00 03 FF 00 7C 3A",
    "0D 0F 00 00 00 10 02 72 8B D3 E7",
    "01 10 00 00 00 02 04 00 01 00 19 63 A5",
]
UNKNOWN = b"\x01\x2b\x0e\x01\x00" + crc(b"\x01\x2b\x0e\x01\x00")


def rtu_frames(data: bytes) -> list[bytes]:
    """Return the frames of a new RTU framer from some bytes and a silence."""
    framer = framer_for(LineProtocol.MODBUS_RTU)
    return framer.feed(data) + framer.silence()


@pytest.mark.parametrize("protocol", [LineProtocol.WISCO, LineProtocol.MODBUS_ASCII])
@pytest.mark.parametrize(
    ("data", "frames"),
    [
        (b"#01RDI\r", [b"#01RDI\r"]),
        (b":010200000010ED\r\n", [b":010200000010ED\r\n"]),
        (b"#01RDI\r:010200000010ED\r\n#", [b"#01RDI\r", b":010200000010ED\r\n"]),
        (b"\r\n\x00x#01RDI\r\n", [b"#01RDI\r"]),
        (b"#01R#02RDO\r", [b"#02RDO\r"]),
        (b":0102\r#02RDO\r", [b"#02RDO\r"]),
        (b"01RDI\r", []),
    ],
)
def test_text_frames(protocol: LineProtocol, data: bytes, frames: list[bytes]) -> None:
    """Switch 8 ON: both kinds on either line, whole and byte by byte; a start begins anew."""
    assert framer_for(protocol).feed(data) == frames
    framer = framer_for(protocol)
    assert [frame for byte in data for frame in framer.feed(bytes([byte]))] == frames
    assert not framer.waiting


def test_text_that_never_ends_is_dropped() -> None:
    """A start character and no end: bounded, and the next frame is heard."""
    framer = framer_for(LineProtocol.WISCO)
    assert framer.feed(b"#" + b"0" * 10 * LONGEST_TEXT_FRAME + b"\r#01RDO\r") == [b"#01RDO\r"]


@pytest.mark.parametrize("request_", RTU_REQUESTS)
def test_rtu_request_is_known_by_its_length(request_: str) -> None:
    """A whole request with its CRC needs no silence, however many pieces it comes in."""
    frame = bytes.fromhex(request_)
    for size in (1, 3, len(frame)):
        framer = framer_for(LineProtocol.MODBUS_RTU)
        pieces = [frame[at : at + size] for at in range(0, len(frame), size)]
        assert [framer.feed(piece) for piece in pieces][-1] == [frame]
        assert not framer.waiting


def test_rtu_frame_of_unknown_function_ends_by_silence() -> None:
    """A frame whose length it is not known is a frame when silence ends it."""
    framer = framer_for(LineProtocol.MODBUS_RTU)
    assert framer.feed(UNKNOWN) == []
    assert framer.waiting
    assert framer.silence() == [UNKNOWN]
    assert not framer.waiting


def test_rtu_noise_ends_by_silence() -> None:
    """Noise in front of a request spoils it, as no silence set it apart; the next is heard."""
    frame = bytes.fromhex(RTU_REQUESTS[0])
    framer = framer_for(LineProtocol.MODBUS_RTU)
    assert framer.feed(b"\x55" + frame) == []
    assert framer.silence() == []
    assert framer.feed(frame) == [frame]


def test_rtu_babble_is_dropped() -> None:
    """Bytes without a pause are bounded, and are no frame."""
    assert rtu_frames(b"\x01\x2b" * 10 * LONGEST_RTU_FRAME) == []
    framer = framer_for(LineProtocol.MODBUS_RTU)
    for _ in range(100):
        framer.feed(bytes(LONGEST_RTU_FRAME))
    assert len(framer.feed(b"") + framer.silence()) == 0


@pytest.mark.parametrize(
    ("protocol", "frame", "address"),
    [
        (LineProtocol.WISCO, b"#1FRDI\r", 31),
        (LineProtocol.WISCO, b":0D01\r\n", 13),
        (LineProtocol.WISCO, b"#\r", None),
        (LineProtocol.MODBUS_RTU, b"\x0d\x01", 13),
    ],
)
def test_station_called(protocol: LineProtocol, frame: bytes, address: int | None) -> None:
    """Faults of a station know their frames."""
    assert framer_for(protocol).address(frame) == address
