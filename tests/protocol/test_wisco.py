import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.frames import all_ways, fed_as_asked
from support.replies import wisco

from bridge.errors import BadReplyError, RefusedError
from bridge.model import DIO100, DO100, ModuleType
from bridge.protocol.request import Request
from bridge.protocol.wisco import (
    ReadInputsHex,
    ReadOutputsHex,
    WriteOutputsMasked,
)
from bridge.protocol.wisco_eeprom import ReadEeprom, WriteEeprom

MODULES = [DIO100, DO100]
OK = wisco("DO>", "OK")


@pytest.mark.parametrize(
    ("request_", "frame"),
    [
        (ReadInputsHex(4), b"#04RDIH\r"),
        (ReadOutputsHex(10, DIO100), b"#0ARDOH\r"),
        (ReadOutputsHex(10, DO100), b"#0ARDOH\r"),
        (WriteOutputsMasked(19, DIO100, 0x73, 0x72), b"#13WDOX73,72\r"),
        (WriteOutputsMasked(13, DO100, 0x8B73, 0x8B72), b"#0DWDOX8B73,8B72\r"),
        (WriteOutputsMasked(0, DO100, 0x1, 0x0), b"#00WDOX0001,0000\r"),
        (WriteOutputsMasked(31, DIO100, 0x1, 0x1), b"#1FWDOX01,01\r"),
    ],
)
def test_requests_are_the_printed_ones(request_: Request[Any], frame: bytes) -> None:
    """Each request in use of docs/protocol.md section 2 is built to the letter."""
    assert request_.frame == frame


@pytest.mark.parametrize(
    ("request_", "reply", "value"),
    [
        (ReadInputsHex(4), b"DI>9EAB\r", 0x9EAB),
        (ReadOutputsHex(10, DIO100), b"DO>D2\r", 0xD2),
        (ReadOutputsHex(10, DO100), b"DO>D56A\r", 0xD56A),
        (WriteOutputsMasked(19, DIO100, 0x73, 0x72), b"DO>OK\r", None),
        (WriteOutputsMasked(13, DO100, 0x8B73, 0x8B72), b"DO>OK\r", None),
    ],
)
def test_replies_are_the_printed_ones(
    request_: Request[Any], reply: bytes, value: int | None
) -> None:
    """Each reply to these of docs/protocol.md section 2 gives its value, whatever way it comes."""
    assert all_ways(request_, reply) == value
    assert request_.reply_chars == len(reply)


def test_the_rightmost_character_has_channel_1() -> None:
    """Bits are written most significant first."""
    assert all_ways(ReadOutputsHex(7, DIO100), b"DO>01\r") == 0x01
    assert all_ways(ReadOutputsHex(7, DIO100), b"DO>80\r") == 0x80


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (1, "illegal function"),
        (2, "illegal data address"),
        (3, "illegal data value"),
        (4, "invalid data frame"),
        (5, "checksum error"),
        (6, "invalid number of bytes"),
    ],
)
@pytest.mark.parametrize(
    "request_",
    [
        ReadInputsHex(1),
        ReadOutputsHex(1, DIO100),
        WriteOutputsMasked(1, DIO100, 1, 1),
        ReadEeprom(1, 0, 500),
        WriteEeprom(1, 0, b"\x00"),
    ],
)
def test_an_error_digit_is_a_refusal(request_: Request[Any], code: int, name: str) -> None:
    """`ERR=n` is a valid no to any request, with the code and the name of section 2."""
    with pytest.raises(RefusedError) as caught:
        all_ways(request_, wisco("ERR=", str(code)))
    assert (caught.value.code, caught.value.name) == (code, name)


@pytest.mark.parametrize("body", ["0", "7", "9", "A", "", "11", " 1"])
def test_another_error_digit_is_a_bad_reply(body: str) -> None:
    """Codes end at 6: anything else in an `ERR=` frame is noise."""
    with pytest.raises(BadReplyError, match="no such error code"):
        all_ways(ReadInputsHex(1), wisco("ERR=", body))


WRONG: dict[str, list[tuple[Request[Any], bytes]]] = {
    # As wide as a reply of the other module: that tells a wrong model.
    "characters came where": [
        (ReadOutputsHex(1, DO100), b"DO>D2\r"),
        (ReadOutputsHex(1, DIO100), b"DO>D56A\r"),
        (ReadInputsHex(1), b"DI>D2\r"),
        (ReadInputsHex(1), b"DI>\r"),
        (ReadInputsHex(1), b"DI>19EAB\r"),
    ],
    # Of the wrong kind: it is late, or from another station.
    "came where": [
        (ReadOutputsHex(1, DIO100), b"DI>9EAB\r"),
        (ReadOutputsHex(1, DIO100), b"DI>D2\r"),
        (ReadInputsHex(1), b"DO>9EAB\r"),
        (WriteOutputsMasked(1, DIO100, 1, 1), b"EE>OK\r"),
        (WriteEeprom(1, 0, b"\x01"), b"DO>OK\r"),
    ],
    # The alphabet is exact: what Python would read as a number is not enough.
    ".": [
        (ReadOutputsHex(1, DIO100), b"DO>OK\r"),
        (ReadOutputsHex(1, DIO100), b"DO>g2\r"),
        (ReadOutputsHex(1, DIO100), b"DO>+2\r"),
        (ReadOutputsHex(1, DO100), b"DO>dD2A\r"),
        (ReadOutputsHex(1, DO100), b"DO>D_2A\r"),
        (ReadOutputsHex(1, DO100), b"DO> D2A\r"),
        (ReadInputsHex(1), b"DI>9EAG\r"),
        (ReadInputsHex(1), b"DI>9EA \r"),
        (WriteOutputsMasked(1, DIO100, 1, 1), b"DO>D2\r"),
        (WriteOutputsMasked(1, DIO100, 1, 1), b"DO>ok\r"),
        (WriteOutputsMasked(1, DIO100, 1, 1), b"DO>OKK\r"),
    ],
}


@pytest.mark.parametrize(
    ("request_", "reply", "told"),
    [(request, reply, told) for told, rows in WRONG.items() for request, reply in rows],
)
def test_another_reply_is_a_bad_reply(request_: Request[Any], reply: bytes, told: str) -> None:
    """A reply of another width, of another kind, or with other characters is not believed."""
    with pytest.raises(BadReplyError, match=told):
        all_ways(request_, reply)


@pytest.mark.parametrize("reply", [b"DO>D56A\r", b"DO>d56a\r"])
def test_hex_digits_may_be_of_either_case(reply: bytes) -> None:
    """One case in one reply: docs/protocol.md, reading hex-case."""
    assert all_ways(ReadOutputsHex(1, DO100), reply) == 0xD56A


def test_the_first_start_counts() -> None:
    """Two garbled replies are not put together to one good one: nothing here has a checksum."""
    with pytest.raises(BadReplyError):
        all_ways(ReadOutputsHex(1, DIO100), b"DO>1DO>D2\r")
    with pytest.raises(BadReplyError):
        all_ways(ReadOutputsHex(1, DIO100), b"DI>9EDO>D2\r")


def test_an_echo_of_the_request_is_skipped() -> None:
    """A request holds no start of a reply, so an adapter's echo passes as noise."""
    request = ReadOutputsHex(1, DIO100)
    assert all_ways(request, request.frame + b"DO>D2\r") == 0xD2


@pytest.mark.parametrize("noise", [b"D", b"DO", b"E", b"ER", b"ERR", b"DOD", b"\r\r", b"DX>1\r"])
def test_noise_that_looks_like_a_start_delays_nothing(noise: bytes) -> None:
    """`missing` never asks for more than a refusal behind such noise would bring."""
    for module, reply in ((DIO100, b"DO>D2\r"), (DO100, b"DO>D56A\r"), (DO100, b"ERR=1\r")):
        decided = fed_as_asked(ReadOutputsHex(1, module), noise + reply)
        assert decided is not None
        assert decided.size == len(noise + reply)


def test_the_shortest_replies_are_read_in_one_go() -> None:
    """The first read is the 6 characters that every reply has at least, then what is left."""
    assert ReadOutputsHex(1, DIO100).missing(b"") == 6
    assert ReadOutputsHex(1, DO100).missing(b"") == 6
    assert ReadOutputsHex(1, DO100).missing(b"DO>D56") == 2
    assert ReadInputsHex(1).missing(b"DI>100") == 2
    assert ReadInputsHex(1).missing(b"ERR") == 3


def test_an_unfinished_reply_is_waited_for() -> None:
    """No beginning of a good reply is judged."""
    for size in range(len(b"DO>D56A\r")):
        assert ReadOutputsHex(1, DO100).decode(b"DO>D56A\r"[:size]) is None


@pytest.mark.parametrize("babble", [b"\x00", b"D", b"DO>1", b"ERR=", b"\r"])
def test_a_babbling_line_is_given_up(babble: bytes) -> None:
    """Far more bytes than any reply has end in a bad reply, not in waiting for ever."""
    request = ReadOutputsHex(1, DO100)
    decided = fed_as_asked(request, babble * 1000)
    assert decided is not None
    assert isinstance(decided.error, BadReplyError)
    assert decided.size < 300


@pytest.mark.parametrize("address", [-1, 32, 255])
@pytest.mark.parametrize("make", [ReadInputsHex, lambda s: ReadOutputsHex(s, DO100)])
def test_stations_run_from_0_to_31(make: Any, address: int) -> None:
    """A station that the DIP switches cannot say is refused."""
    with pytest.raises(ValueError, match="station"):
        make(address)


@pytest.mark.parametrize(
    ("module", "mask", "values"),
    [
        (DIO100, 0, 0),
        (DIO100, 0x100, 0),
        (DIO100, 0x01, 0x100),
        (DIO100, -1, 0),
        (DIO100, 0x01, -1),
        (DO100, 0, 1),
        (DO100, 0x10000, 0),
        (DO100, 0x01, 0x10000),
    ],
)
def test_masks_stay_inside_the_module(module: ModuleType, mask: int, values: int) -> None:
    """An empty mask and channels that the module lacks are refused."""
    with pytest.raises(ValueError, match=r"mask|values"):
        WriteOutputsMasked(1, module, mask, values)


@pytest.mark.parametrize("text", ["1", "1\r#02WDO1,1", b"1", "ON", 1.5])
def test_text_never_becomes_a_frame(text: Any) -> None:
    """Encoders take integers: a payload that slipped through is an error, not a frame."""
    for make in (
        lambda: ReadInputsHex(text),
        lambda: WriteOutputsMasked(1, DIO100, text, 0),
        lambda: WriteOutputsMasked(1, DIO100, 1, text),
        lambda: ReadEeprom(1, text, 1),
        lambda: ReadEeprom(1, 0, text),
    ):
        with pytest.raises((TypeError, ValueError)):
            make()


def test_requests_are_values() -> None:
    """Equal requests are equal and hashable, and none can be changed after it was built."""
    request = ReadOutputsHex(1, DIO100)
    assert request == ReadOutputsHex(1, DIO100)
    assert len({request, ReadOutputsHex(1, DIO100), ReadOutputsHex(2, DIO100)}) == 2
    with pytest.raises(dataclasses.FrozenInstanceError):
        request.frame = b"#01WDO1,1\r"  # type: ignore[misc]  # that it is refused is the point


@given(module=st.sampled_from(MODULES), bits=st.integers(0, 0xFFFF))
def test_reads_return_the_bits(module: ModuleType, bits: int) -> None:
    """Reads return any channels unchanged."""
    outputs = bits % (1 << module.outputs)
    digits = module.outputs // 4
    assert all_ways(ReadInputsHex(1), wisco("DI>", f"{bits:04X}")) == bits
    assert all_ways(ReadOutputsHex(1, module), wisco("DO>", f"{outputs:0{digits}X}")) == outputs


@given(noise=st.binary(max_size=40).filter(lambda noise: b">" not in noise and b"=" not in noise))
def test_any_noise_before_the_start_is_skipped(noise: bytes) -> None:
    """Noise without a start changes nothing about the value."""
    request = ReadInputsHex(1)
    decided = fed_as_asked(request, noise + b"DI>9EAB\r")
    assert decided is not None
    assert (decided.value, decided.error) == (0x9EAB, None)
