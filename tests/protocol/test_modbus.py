"""The frames of docs/protocol.md section 4, and the PDUs behind them."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import replies
from support.frames import all_ways

from bridge.errors import BadReplyError, RefusedError
from bridge.protocol.ascii import AsciiRequest
from bridge.protocol.modbus import (
    Pdu,
    ReadCoils,
    ReadDiscreteInputs,
    ReadHoldingRegisters,
    WriteCoil,
    WriteCoils,
    WriteRegister,
)
from bridge.protocol.request import Request
from bridge.protocol.rtu import RtuRequest

Framing = Callable[[int, Pdu[Any]], Request[Any]]
FRAMINGS: list[tuple[Framing, Callable[..., bytes]]] = [
    (RtuRequest, replies.rtu),
    (AsciiRequest, replies.ascii_frame),
]
EVERY_PDU = [
    ReadCoils(0, 8),
    ReadDiscreteInputs(0, 16),
    ReadHoldingRegisters(0, 9),
    WriteCoil(3, True),
    WriteRegister(1, 25),
    WriteCoils(0, 8, 0x72),
]


def ascii_bytes(text: str) -> bytes:
    """A printed ASCII frame as it goes on the wire."""
    return f"{text}\r\n".encode()


@pytest.mark.parametrize(
    ("address", "pdu", "rtu", "ascii_text"),
    [
        (1, ReadDiscreteInputs(0, 16), "01 02 00 00 00 10 79 C6", ":010200000010ED"),
        (1, ReadCoils(0, 8), "01 01 00 00 00 08 3D CC", ":010100000008F6"),
        (1, WriteCoil(3, True), "01 05 00 03 FF 00 7C 3A", ":01050003FF00F8"),
        (1, WriteCoil(3, False), "01 05 00 03 00 00 3D CA", ":010500030000F7"),
        (1, WriteCoils(0, 8, 0x72), "01 0F 00 00 00 08 01 72 7E B0", ":010F00000008017275"),
        (
            13,
            WriteCoils(0, 16, 0x8B72),
            "0D 0F 00 00 00 10 02 72 8B D3 E7",
            ":0D0F0000001002728BD5",
        ),
        (1, ReadHoldingRegisters(0, 9), "01 03 00 00 00 09 85 CC", ":010300000009F3"),
        (1, WriteRegister(1, 25), "01 06 00 01 00 19 19 C0", ":010600010019DF"),
    ],
)
def test_requests_are_the_printed_ones(
    address: int, pdu: Pdu[Any], rtu: str, ascii_text: str
) -> None:
    """Each request in use of docs/protocol.md section 4 is built to the letter, in both."""
    assert RtuRequest(address, pdu).frame == bytes.fromhex(rtu)
    assert AsciiRequest(address, pdu).frame == ascii_bytes(ascii_text)


@pytest.mark.parametrize(
    ("address", "pdu", "ascii_text"),
    [(1, ReadCoils(2, 5), ":010100020005F7"), (0x1C, WriteRegister(2, 0x01E5), ":1C06000201E5F6")],
)
def test_requests_are_those_of_the_manuals(address: int, pdu: Pdu[Any], ascii_text: str) -> None:
    """The manuals' own examples of Modbus ASCII."""
    assert AsciiRequest(address, pdu).frame == ascii_bytes(ascii_text)


@pytest.mark.parametrize(
    ("pdu", "rtu", "ascii_text", "value"),
    [
        (ReadDiscreteInputs(0, 16), "01 02 02 AB 9E 47 20", ":010202AB9EB2", 0x9EAB),
        (ReadCoils(0, 8), "01 01 01 D2 D1 D5", ":010101D22B", 0xD2),
        (WriteCoils(0, 8, 0x72), "01 0F 00 00 00 08 54 0D", ":010F00000008E8", None),
        # An echo is the whole reply.
        (WriteCoil(3, True), "01 05 00 03 FF 00 7C 3A", ":01050003FF00F8", None),
        (WriteCoil(3, False), "01 05 00 03 00 00 3D CA", ":010500030000F7", None),
        (WriteRegister(1, 25), "01 06 00 01 00 19 19 C0", ":010600010019DF", None),
    ],
)
def test_replies_are_the_printed_ones(
    pdu: Pdu[Any], rtu: str, ascii_text: str, value: int | None
) -> None:
    """Each reply to these of docs/protocol.md section 4 gives its value, whatever way it comes."""
    for request, reply in (
        (RtuRequest(1, pdu), bytes.fromhex(rtu)),
        (AsciiRequest(1, pdu), ascii_bytes(ascii_text)),
    ):
        assert all_ways(request, reply) == value
        assert request.reply_chars == len(reply)


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (1, "illegal function"),
        (2, "illegal data address"),
        (3, "illegal data value"),
        (4, "device failure"),
        (11, "unknown exception"),
    ],
)
@pytest.mark.parametrize(("framing", "build"), FRAMINGS)
@pytest.mark.parametrize("pdu", EVERY_PDU)
def test_every_function_can_be_refused(
    framing: Framing, build: Callable[..., bytes], pdu: Pdu[Any], code: int, name: str
) -> None:
    """Function | 80h and a code answer any request, codes outside the standard too."""
    with pytest.raises(RefusedError) as caught:
        all_ways(framing(7, pdu), build(7, pdu.data[0] | 0x80, code))
    assert (caught.value.code, caught.value.name) == (code, name)


@pytest.mark.parametrize(("framing", "build"), FRAMINGS)
@pytest.mark.parametrize("pdu", EVERY_PDU)
def test_another_station_is_told_by_name(
    framing: Framing, build: Callable[..., bytes], pdu: Pdu[Any]
) -> None:
    """A valid frame from the wrong station is no answer, a refusal neither."""
    body = pdu.head + bytes(pdu.reply_bytes - len(pdu.head))
    for reply in (build(9, *body), build(9, pdu.data[0] | 0x80, 1)):
        with pytest.raises(BadReplyError, match="station 9 answered for station 7"):
            all_ways(framing(7, pdu), reply)


@pytest.mark.parametrize(("framing", "build"), FRAMINGS)
@pytest.mark.parametrize(
    ("pdu", "body", "evidence"),
    [
        (ReadCoils(0, 8), "02 01 D2", "function 02 answered function 01"),
        (ReadCoils(0, 8), "82 01", "function 82 answered function 01"),
        (ReadCoils(0, 8), "01 02 D2 00", "01 02 d2 00 does not answer"),
        (ReadCoils(0, 16), "01 01 D2", "01 01 d2 does not answer"),
        (ReadDiscreteInputs(0, 16), "02 01 AB", "does not answer"),
        (ReadHoldingRegisters(0, 9), "03 02 00 01", "does not answer"),
        (WriteCoil(3, True), "05 00 02 FF 00", "does not answer"),
        (WriteCoil(3, True), "05 00 03 00 00", "05 00 03 00 00 does not answer 05 00 03 ff 00"),
        (WriteRegister(1, 25), "06 00 01 00 1A", "does not answer"),
        (WriteCoils(0, 8, 1), "0F 00 01 00 08", "does not answer"),
        (WriteCoils(0, 8, 1), "0F 00 00 00 07", "does not answer"),
    ],
)
def test_an_answer_to_another_question_is_a_bad_reply(
    framing: Framing, build: Callable[..., bytes], pdu: Pdu[Any], body: str, evidence: str
) -> None:
    """Function, byte count and, for writes, address and value must be exactly what was asked."""
    with pytest.raises(BadReplyError, match=evidence):
        all_ways(framing(1, pdu), build(1, *bytes.fromhex(body)))


@pytest.mark.parametrize("framing", [RtuRequest, AsciiRequest])
@pytest.mark.parametrize("address", [-1, 0, 32, 255])
def test_nobody_is_addressed_but_stations_1_to_31(framing: Framing, address: int) -> None:
    """0 would be obeyed by every module on the line, and answered by none."""
    with pytest.raises(ValueError, match="Modbus station"):
        framing(address, ReadCoils(0, 8))


@pytest.mark.parametrize(
    "make",
    [
        lambda: ReadCoils(0, 0),
        lambda: ReadCoils(0, 2001),
        lambda: ReadCoils(-1, 1),
        lambda: ReadCoils(0x10000, 1),
        lambda: ReadDiscreteInputs(0xFFFF, 2),
        lambda: ReadHoldingRegisters(0, 0),
        lambda: ReadHoldingRegisters(0, 126),
        lambda: WriteCoil(-1, True),
        lambda: WriteCoil(0x10000, True),
        lambda: WriteRegister(-1, 0),
        lambda: WriteRegister(0x10000, 0),
        lambda: WriteRegister(0, -1),
        lambda: WriteRegister(0, 0x10000),
        lambda: WriteCoils(0, 0, 0),
        lambda: WriteCoils(0, 1969, 0),
        lambda: WriteCoils(0, 8, 0x100),
        lambda: WriteCoils(0, 8, -1),
    ],
)
def test_arguments_outside_modbus_are_refused(make: Callable[[], Pdu[Any]]) -> None:
    """Addresses, values and quantities stay inside what the standard allows."""
    with pytest.raises(ValueError, match=r"is not in|has bits outside"):
        make()


def test_the_largest_quantities_are_valid() -> None:
    """The limits themselves are allowed, and fit into a PDU."""
    assert ReadCoils(0, 2000).reply_bytes == 2 + 250
    assert ReadHoldingRegisters(0, 125).reply_bytes == 2 + 250
    assert len(WriteCoils(0, 1968, 0).data) == 6 + 246


def test_what_fills_the_last_byte_is_no_channel() -> None:
    """Bits above the quantity say nothing."""
    request = RtuRequest(1, ReadCoils(2, 5))
    assert all_ways(request, replies.rtu(1, 1, 1, 0xF5)) == 0x15


@given(address=st.integers(1, 31), bits=st.integers(0, 0xFFFF))
def test_bits_come_low_byte_first(address: int, bits: int) -> None:
    """Bit n-1 is channel n, in both framings and for every value."""
    body = (address, 0x02, 2, bits & 0xFF, bits >> 8)
    for framing, build in FRAMINGS:
        assert all_ways(framing(address, ReadDiscreteInputs(0, 16)), build(*body)) == bits


@given(values=st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=17))
def test_registers_come_high_byte_first(values: list[int]) -> None:
    """The register at the lowest address is the first."""
    data = [byte for value in values for byte in (value >> 8, value & 0xFF)]
    body = (5, 0x03, len(data), *data)
    for framing, build in FRAMINGS:
        request = framing(5, ReadHoldingRegisters(0, len(values)))
        assert all_ways(request, build(*body)) == tuple(values)
