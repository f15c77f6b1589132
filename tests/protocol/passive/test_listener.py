"""Reading along: frames of all protocols found, requests and replies told apart, errors named."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.model import LineProtocol
from bridge.protocol.checksum import crc16
from bridge.protocol.passive.listener import Heard, Listener, PieceWay

RTU, ASCII, WISCO = LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII, LineProtocol.WISCO


def rtu(digits: str) -> bytes:
    """Adds the CRC."""
    data = bytes.fromhex(digits)
    return data + crc16(data).to_bytes(2, "little")


def listen(*pieces: bytes, every_s: float = 0.01) -> list[Heard]:
    """Hears the pieces one after the other, then a long silence."""
    listener = Listener()
    heard = []
    for number, piece in enumerate(pieces):
        heard += listener.hear(piece, number * every_s)
    return heard + listener.pass_time(len(pieces) * every_s + 10)


def shown(heard: list[Heard]) -> list[str]:
    """Direction, station, meaning."""
    return [f"{one.way} {one.address} {one.meaning}" for one in heard]


# docs/protocol.md sections 2 and 4: each exchange as it stands there, and what it means.
EXCHANGES = [
    (WISCO, b"#01RDI\r", b"DI>1001111010101011\r",
     "read inputs", "inputs ON: 1, 2, 4, 6, 8, 10, 11, 12, 13, 16"),
    (WISCO, b"#04RDIH\r", b"DI>9EAB\r",
     "read inputs", "inputs ON: 1, 2, 4, 6, 8, 10, 11, 12, 13, 16"),
    (WISCO, b"#07RDO\r", b"DO>11010010\r", "read outputs", "outputs ON: 2, 5, 7, 8"),
    (WISCO, b"#0ARDOH\r", b"DO>D2\r", "read outputs", "outputs ON: 2, 5, 7, 8"),
    (WISCO, b"#10WDO124,010\r", b"DO>OK\r", "outputs 1 OFF, 2 ON, 4 OFF", "done"),
    (WISCO, b"#13WDOX73,72\r", b"DO>OK\r",
     "outputs 1 OFF, 2 ON, 5 ON, 6 ON, 7 ON", "done"),
    (WISCO, b"#0DREE0020001F4\r", b"EE>0102FD\r", "read EEPROM 0200h, 500 bytes",
     "EEPROM: 01 02"),
    (WISCO, b"#16WEE00100021234B7\r", b"EE>OK\r", "write EEPROM 0100h: 12 34", "done"),
    (RTU, rtu("01 02 0000 0010"), rtu("01 02 02 AB9E"), "read inputs 1-16",
     "inputs ON: 1, 2, 4, 6, 8, 10, 11, 12, 13, 16"),
    (RTU, rtu("01 01 0000 0008"), rtu("01 01 01 D2"), "read outputs 1-8",
     "outputs ON: 2, 5, 7, 8"),
    (RTU, rtu("01 05 0003 FF00"), rtu("01 05 0003 FF00"), "output 4 ON", "done: output 4 ON"),
    (RTU, rtu("01 05 0003 0000"), rtu("01 05 0003 0000"), "output 4 OFF", "done: output 4 OFF"),
    (RTU, rtu("01 0F 0000 0008 01 72"), rtu("01 0F 0000 0008"),
     "outputs 1-8: ON: 2, 5, 6, 7", "done: outputs 1-8: ON: 2, 5, 6, 7"),
    (RTU, rtu("01 03 0000 0002"), rtu("01 03 04 0001 0019"), "read registers 40001-40002",
     "registers: pulse: 1; hold time 2.5 s: 1"),
    (RTU, rtu("01 06 0001 0019"), rtu("01 06 0001 0019"),
     "register 40002 (hold time of output 1): 2.5 s",
     "done: register 40002 (hold time of output 1): 2.5 s"),
    (RTU, rtu("01 10 0000 0002 04 0001 0019"), rtu("01 10 0000 0002"),
     "registers 40001-40002: pulse: 1; hold time 2.5 s: 1",
     "done: registers 40001-40002: pulse: 1; hold time 2.5 s: 1"),
    (ASCII, b":010200000010ED\r\n", b":010202AB9EB2\r\n", "read inputs 1-16",
     "inputs ON: 1, 2, 4, 6, 8, 10, 11, 12, 13, 16"),
    (ASCII, b":01050003FF00F8\r\n", b":01050003FF00F8\r\n", "output 4 ON", "done: output 4 ON"),
    # A reply of three bytes of bits is as long as a request: what was asked tells it.
    (RTU, rtu("05 01 0000 0018"), rtu("05 01 03 010000"), "read outputs 1-24", "outputs ON: 1"),
]  # fmt: skip


@pytest.mark.parametrize(("protocol", "request_", "reply", "asks", "says"), EXCHANGES)
def test_an_exchange_is_read(
    protocol: LineProtocol, request_: bytes, reply: bytes, asks: str, says: str
) -> None:
    """The protocol is recognised, the request and its reply are told apart and in words."""
    asked, said = listen(request_, reply)
    assert (asked.way, asked.data, asked.meaning, asked.problem) == (">", request_, asks, None)
    assert (said.way, said.data, said.meaning, said.problem) == ("<", reply, says, None)
    assert asked.protocol is said.protocol is protocol
    assert asked.address == said.address
    assert (asked.gap_s, said.gap_s, said.reply_s) == (None, 0.01, 0.01)


def test_all_exchanges_in_one_go_and_byte_by_byte() -> None:
    """However the adapter delivers the bytes, the same pieces are heard."""
    pieces = [piece for _, request, reply, *_ in EXCHANGES for piece in (request, reply)]
    whole = listen(b"".join(pieces))
    single = listen(*[bytes([byte]) for byte in b"".join(pieces)], every_s=0.001)
    assert [one.data for one in whole] == [one.data for one in single] == pieces
    assert shown(whole) == shown(single) == shown(listen(*pieces))


@pytest.mark.parametrize(
    ("pieces", "problem", "address"),
    [
        ([rtu("01 02 0000 0010"), rtu("01 82 01")], "refused: illegal function", 1),
        ([b"#01RDI\r", b"ERR=1\r"], "refused: illegal function", 1),
        ([b"#01RDI\r", b"ERR=9\r"], "no such error code", 1),
        ([rtu("01 02 0000 0010"), rtu("02 02 02 AB9E")],
         "station 2 answered for station 1", 2),
        ([rtu("01 02 0000 0010"), rtu("01 01 01 AB")], "function 01 answered function 02", 1),
        ([rtu("01 02 02 AB9E")], "this was not requested", 1),
        ([b"DI>9EAB\r"], "this was not requested", None),
        ([b"#01RDI\r", b"DI>9EA\r"], "not in the form of any reply", 1),
        ([b"#01REE000000001\r", b"EE>01FE\r"], "checksum FE where FF is due", 1),
        ([rtu("01 02 0000 0010"), bytes.fromhex("010202AB9E4721")],
         "an RTU frame of station 1 with a wrong CRC, or a part of one", 1),
        ([b":010200000010ED\r\n", b":010202AB9EB3\r\n"],
         "Modbus ASCII with LRC B3 where B2 is due", 1),
        ([b":01020000\r\n"], "Modbus ASCII with LRC 00 where FD is due", None),
        ([b":01a200000010ed\r\n"],
         "Modbus ASCII with lower-case digits: the modules write upper case", None),
        ([b":0102000\r\n"], "Modbus ASCII of a length that no frame has", None),
        ([b"#01RDI"], "a text frame that broke off or was damaged", None),
        ([b"\xff\xff\xfe"], "noise", None),
        ([rtu("03 02 0000 0010")], "station 3 did not answer", 3),
        ([b"#03RDI\r"], "station 3 did not answer", 3),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(pieces: list[bytes], problem: str, address: int | None) -> None:
    """The last piece names the fault and the station."""
    last = listen(*pieces)[-1]
    assert (last.problem, last.address) == (problem, address)


def test_a_damaged_reply_is_one_problem() -> None:
    """A damaged reply is reported once, without a missing reply as well."""
    heard = listen(rtu("01 02 0000 0010"), bytes.fromhex("010202AB9E4721"), rtu("01 02 0000 0010"),
                   rtu("01 02 02 AB9E"))  # fmt: skip
    assert [one.way for one in heard] == [
        PieceWay.REQUEST,
        PieceWay.UNKNOWN,
        PieceWay.REQUEST,
        PieceWay.REPLY,
    ]


def test_noise_in_front_of_a_frame_is_told_apart() -> None:
    """The frame behind it is found at once."""
    noise, request, reply = listen(b"\x00\x81" + rtu("01 02 0000 0010"), rtu("01 02 02 AB9E"))
    assert (noise.data, noise.problem) == (b"\x00\x81", "noise")
    assert request.meaning == "read inputs 1-16"
    assert reply.problem is None


def test_a_repeated_write_is_no_reply() -> None:
    """The same bytes long after the first are the master's second try."""
    write = rtu("01 05 0003 FF00")
    listener = Listener()
    heard = listener.hear(write, 0.0) + listener.hear(write, 0.2) + listener.hear(write, 0.21)
    assert [one.way for one in heard] == [
        PieceWay.REQUEST,
        PieceWay.REPLY,
        PieceWay.REQUEST,
        PieceWay.REPLY,
    ]
    assert [one.unanswered for one in heard] == [False, True, False, False]


@pytest.mark.parametrize(
    ("request_", "meaning"),
    [
        (b"#01XYZ\r", "unknown command XYZ"),
        (b"#01WDO12\r", "unknown command WDO12"),
        (b"#01WDOX1,G\r", "unknown command WDOX1,G"),
        (b"#01WEE00100021Z34B7\r", "unknown command WEE00100021Z34B7"),
        (rtu("01 06 0000 0003"), "register 40001 (output modes): pulse: 1, 2"),
        (rtu("01 04 0002 0001"), "read input registers 30003"),
    ],
)
def test_a_request_that_is_unusual_is_shown_as_it_is(request_: bytes, meaning: str) -> None:
    """An unusual request is shown as it is."""
    assert listen(request_)[0].meaning == meaning


def test_a_broadcast_is_not_waited_for() -> None:
    """No module answers station 0 in Modbus, and that is as it should be."""
    (heard,) = listen(rtu("00 05 0003 FF00"))
    assert heard.problem is None


def test_a_function_of_other_devices_is_found_by_its_silence() -> None:
    """An unknown function is recognised by the silence after it and its CRC."""
    heard = listen(rtu("21 2B 0E 01 00"))
    assert (heard[0].way, heard[0].meaning) == (PieceWay.REQUEST, "function 2Bh: 0E 01 00")


@given(st.lists(st.binary(max_size=40), max_size=20))
def test_nothing_that_passes_ends_it_or_is_lost(pieces: list[bytes]) -> None:
    """Every byte that passes is reported, for any bytes."""
    assert b"".join(one.data for one in listen(*pieces)) == b"".join(pieces)


@given(
    st.lists(
        st.sampled_from([part for _, request, reply, *_ in EXCHANGES for part in (request, reply)])
        | st.binary(min_size=1, max_size=3)
        | st.binary(min_size=1, max_size=6).map(lambda data: rtu(data.hex())),
        max_size=20,
    )
)
def test_frames_in_any_order_are_told_byte_for_byte(pieces: list[bytes]) -> None:
    """Replies without requests, wrong functions, cut and strange frames: all of it is told."""
    assert b"".join(one.data for one in listen(b"".join(pieces))) == b"".join(pieces)


def test_a_line_that_never_pauses_is_not_held_for_ever() -> None:
    """On a line that never pauses, bytes that cannot be a frame are reported as noise."""
    heard = Listener().hear(b"\xff" * 5000, 0.0)
    assert [(one.problem, len(one.data)) for one in heard] == [("noise", 5000)]


def test_who_knows_the_way_need_not_guess() -> None:
    """A write and its reply are alike; told which is which, no time has to tell."""
    listener = Listener()
    write = bytes.fromhex("01 05 00 03 FF 00 7C 3A")
    ways = [
        one.way
        for at, sent in ((0.0, True), (0.5, False), (0.6, True), (0.61, True))
        for one in listener.hear(write, at, sent=sent)
        if one.data
    ]
    assert ways == [PieceWay.REQUEST, PieceWay.REPLY, PieceWay.REQUEST, PieceWay.REQUEST]


def test_a_frame_does_not_go_on_the_other_way() -> None:
    """A broken frame is not joined with bytes of the other direction."""
    listener = Listener()
    assert listener.hear(b"#01RD", 0.0, sent=True) == []
    told = listener.hear(b"IH\r", 0.01, sent=False)
    assert b"#01RDIH\r" not in [one.data for one in told]
