from hypothesis import given
from hypothesis import strategies as st
from support import replies

from bridge.protocol.checksum import crc16, lrc, wisco_checksum


def test_crc_of_the_standards_check_string() -> None:
    """The catalogued check value of CRC-16/MODBUS over "123456789" is 4B37h."""
    assert crc16(b"123456789") == 0x4B37


def test_crc_of_nothing_is_its_start_value() -> None:
    """No bytes leave the start value, so that leading zeros are seen."""
    assert crc16(b"") == 0xFFFF


@given(st.binary(max_size=64))
def test_crc_agrees_with_a_bitwise_division(data: bytes) -> None:
    """The table gives what the plain division gives, and 0 over data with its own CRC."""
    framed = replies.rtu(*data)
    assert crc16(data) == int.from_bytes(framed[-2:], "little")
    assert crc16(framed) == 0


def test_lrc_of_the_manuals_example() -> None:
    """docs/protocol.md section 3: 1C 06 0002 01E5 sum to 10Ah, so F6h."""
    assert lrc(bytes.fromhex("1C06000201E5")) == 0xF6


def test_wisco_checksum_of_the_manuals_examples() -> None:
    """docs/protocol.md section 2: FCh for five bytes from 0, B7h for `0100 02 1234`."""
    assert wisco_checksum(bytes.fromhex("0000051122334455")) == 0xFC
    assert wisco_checksum(bytes.fromhex("0100021234")) == 0xB7


def test_a_sum_of_nothing_is_nothing() -> None:
    """The complement of 0 stays a byte: 0, not 100h."""
    assert lrc(b"") == 0
    assert lrc(b"\x80\x80") == 0


@given(st.binary(max_size=64))
def test_lrc_over_its_own_is_nothing(data: bytes) -> None:
    """A receiver that sums the LRC in gets 0."""
    assert lrc(data + bytes([lrc(data)])) == 0
