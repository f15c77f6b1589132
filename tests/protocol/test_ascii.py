import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.frames import all_ways, fed_as_asked, judge

from bridge.errors import BadReplyError
from bridge.protocol.ascii import AsciiRequest
from bridge.protocol.modbus import ReadDiscreteInputs, ReadHoldingRegisters

INPUTS = AsciiRequest(1, ReadDiscreteInputs(0, 16))
REPLY = b":010202AB9EB2\r\n"


def test_the_first_read_is_a_refusals_eleven_characters() -> None:
    """More could keep the line waiting for characters that an exception does not have."""
    assert INPUTS.missing(b"") == 11
    assert INPUTS.missing(REPLY[:11]) == 4
    assert INPUTS.missing(b":0182") == 6
    assert INPUTS.missing(REPLY) == 0


@pytest.mark.parametrize(
    ("reply", "evidence"),
    [
        (b":010202aB9eb2\r\n", "outside the alphabet"),
        (b":010202AB 9EB2\r\n", "outside the alphabet"),
        (b":010202AB9GB2\r\n", "outside the alphabet"),
        (b":010202AB9EB\r\n", "hex"),
        (b":010202AB9EB3\r\n", "LRC B3 came where B2 is due"),
        (b":010202AB9EB2\n", "no CR before the LF"),
        (b":010202AB9EB2\r\r\n", "outside the alphabet"),
        (b":\r\n", "too few"),
        (b":\n", "no CR"),
        (b":0102FD\r\n", "too few"),
        (b":010202AB9E0000B2\r\n", "does not answer"),
    ],
)
def test_the_form_is_exact(reply: bytes, evidence: str) -> None:
    """Hex of one case, an LRC that fits, CR LF: else it is a bad reply as soon as it has ended."""
    with pytest.raises(BadReplyError, match=evidence):
        all_ways(INPUTS, reply)


def test_a_colon_begins_anew() -> None:
    """A frame that was cut off, by whomever, is forgotten at the next colon."""
    assert all_ways(INPUTS, b":0102" + REPLY) == 0x9EAB
    assert all_ways(INPUTS, b"::" + REPLY) == 0x9EAB


@pytest.mark.parametrize("noise", [b"DO>OK\r", b"DI>9EAB\r\n", b"#01RDI\r", b"\n\n", b"\r\n"])
def test_wisco_frames_on_the_same_line_are_noise(noise: bytes) -> None:
    """DIP switch 8 leaves both protocols on: a late Wisco reply does not spoil this one."""
    assert all_ways(INPUTS, noise + REPLY) == 0x9EAB


@pytest.mark.parametrize("babble", [b"\x00", b":", b"0", b":01", b"\r", b"\n"])
def test_a_babbling_line_is_given_up(babble: bytes) -> None:
    """Far more bytes than any reply has end in a bad reply, not in waiting for ever."""
    decided = fed_as_asked(INPUTS, babble * 1000)
    assert decided is not None
    assert isinstance(decided.error, BadReplyError)
    assert decided.size < 300


def test_an_unfinished_reply_is_waited_for() -> None:
    """No beginning of a good reply is judged, and each asks for what is left or less."""
    for size in range(len(REPLY)):
        assert judge(INPUTS, REPLY[:size]) is None
        assert 1 <= INPUTS.missing(REPLY[:size]) <= len(REPLY) - size


def test_a_long_reply_is_read_in_two_pieces() -> None:
    """Eleven characters tell that it is no refusal; then all the rest is asked for."""
    request = AsciiRequest(31, ReadHoldingRegisters(0, 17))
    assert request.missing(b":1F03220000") == request.reply_chars - 11


@given(noise=st.binary(max_size=40).filter(lambda noise: b":" not in noise))
def test_any_noise_before_the_colon_is_skipped(noise: bytes) -> None:
    """Noise without a colon changes nothing about the value."""
    decided = fed_as_asked(INPUTS, noise + REPLY)
    assert decided is not None
    assert (decided.value, decided.error) == (0x9EAB, None)
