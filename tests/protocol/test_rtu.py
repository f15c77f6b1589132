import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support import replies
from support.frames import fed_as_asked, fed_bytewise, fed_whole, judge

from bridge.errors import BadReplyError, RefusedError
from bridge.protocol.modbus import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, WriteCoil
from bridge.protocol.rtu import RtuRequest

INPUTS = RtuRequest(1, ReadDiscreteInputs(0, 16))
REPLY = bytes.fromhex("01 02 02 AB 9E 47 20")


def test_the_first_read_is_a_refusals_five_bytes() -> None:
    """More could keep the line waiting for bytes that an exception does not have."""
    assert INPUTS.missing(b"") == 5
    assert INPUTS.missing(REPLY[:5]) == 2
    assert INPUTS.missing(b"\x01\x82") == 3
    assert INPUTS.missing(REPLY) == 0


def test_a_long_reply_is_read_in_few_pieces() -> None:
    """Once our frame has begun, its whole rest is read in one piece."""
    request = RtuRequest(1, ReadHoldingRegisters(0, 17))
    reply = replies.rtu(1, 3, 34, *range(34))
    assert request.missing(reply[:10]) == len(reply) - 10
    decided = fed_as_asked(request, reply)
    assert decided is not None
    assert (decided.error, decided.size) == (None, len(reply))


@pytest.mark.parametrize("size", range(9))
@pytest.mark.parametrize("filler", [0x00, 0x01, 0x02, 0x81, 0xFF])
def test_up_to_eight_bytes_of_noise_are_skipped(size: int, filler: int) -> None:
    """A frame after any eight bytes of noise is found by its CRC."""
    for reply, expected in ((REPLY, 0x9EAB), (bytes.fromhex("01 82 01 81 60"), RefusedError)):
        for feed in (fed_whole, fed_bytewise, fed_as_asked):
            decided = feed(INPUTS, bytes([filler]) * size + reply)
            assert decided is not None
            assert expected in (decided.value, type(decided.error))


def test_nine_bytes_of_noise_are_too_many() -> None:
    """After nine bytes of noise the reply counts as lost."""
    for feed in (fed_whole, fed_bytewise, fed_as_asked):
        decided = feed(INPUTS, bytes(9) + REPLY)
        assert decided is not None
        assert isinstance(decided.error, BadReplyError)
        assert "no valid frame from station 1" in str(decided.error)


def test_a_reply_that_cannot_come_any_more_is_bad_at_once() -> None:
    """Nine strange bytes are enough: there is no waiting for the rest of a frame's length."""
    assert judge(INPUTS, bytes(8)) is None
    decided = judge(INPUTS, bytes(9))
    assert decided is not None
    assert isinstance(decided.error, BadReplyError)


def test_a_wrong_crc_is_waited_out() -> None:
    """No terminator tells that it was all: more bytes may still bring the reply."""
    spoilt = REPLY[:-1] + b"\x21"
    assert judge(INPUTS, spoilt) is None
    decided = fed_as_asked(INPUTS, spoilt + REPLY)
    assert decided is not None
    assert decided.value == 0x9EAB


def test_a_wrong_crc_ends_as_a_bad_reply() -> None:
    """A stream of spoilt replies is given up within the bound on noise."""
    decided = fed_as_asked(INPUTS, (REPLY[:-1] + b"\x21") * 9)
    assert decided is not None
    assert isinstance(decided.error, BadReplyError)
    assert decided.size <= 8 + len(REPLY)


def test_an_echo_of_a_read_is_skipped() -> None:
    """A request is no valid reply, and not longer than the noise that is tolerated."""
    decided = fed_as_asked(INPUTS, INPUTS.frame + REPLY)
    assert decided is not None
    assert decided.value == 0x9EAB


def test_another_stations_longer_reply_is_told_as_it_ends() -> None:
    """A longer reply of another station is recognised by the length in it."""
    request = RtuRequest(7, ReadCoils(0, 8))
    decided = fed_as_asked(request, replies.rtu(9, 2, 2, 0xAB, 0x9E))
    assert decided is not None
    assert "station 9 answered for station 7" in str(decided.error)


def test_an_unfinished_reply_is_waited_for() -> None:
    """No beginning of a good reply is judged, and each asks for what is left or less."""
    for size in range(len(REPLY)):
        assert INPUTS.decode(REPLY[:size]) is None
        assert 1 <= INPUTS.missing(REPLY[:size]) <= len(REPLY) - size


def test_a_frame_inside_a_frame_is_data() -> None:
    """While a reply of ours arrives, nothing within it is taken for a reply."""
    inner = replies.rtu(1, 0x83, 2)
    reply = replies.rtu(1, 3, 6, *inner, 0)
    request = RtuRequest(1, ReadHoldingRegisters(0, 3))
    for feed in (fed_whole, fed_bytewise, fed_as_asked):
        decided = feed(request, reply)
        assert decided is not None
        assert decided.error is None


def holds_frame(data: bytes, before: int) -> bool:
    """Whether some bytes that begin `before` this place are a frame by chance."""
    return any(
        data[at:end] == replies.rtu(*data[at : end - 2])
        for at in range(before)
        for end in range(at + 4, len(data) + 1)
    )


@given(
    address=st.integers(1, 31),
    noise=st.binary(max_size=8),
    on=st.booleans(),
    refused=st.booleans(),
)
def test_random_noise_before_a_reply_is_skipped(
    address: int, noise: bytes, on: bool, refused: bool
) -> None:
    """Any noise of up to eight bytes, and any station: the reply is found, however it comes."""
    request = RtuRequest(address, WriteCoil(3, on))
    reply = replies.rtu(address, 0x85, 4) if refused else request.frame
    assume(not holds_frame(noise + reply, before=len(noise)))
    for feed in (fed_whole, fed_bytewise, fed_as_asked):
        decided = feed(request, noise + reply)
        assert decided is not None
        assert isinstance(decided.error, RefusedError) == refused
        assert decided.size == len(noise + reply)
