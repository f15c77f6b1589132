import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.frames import all_ways
from support.replies import eeprom, wisco

from bridge.errors import BadReplyError
from bridge.protocol.wisco_eeprom import ReadEeprom, WriteEeprom


def test_reading_is_the_printed_request() -> None:
    """docs/protocol.md section 2: 500 bytes from 200h, station 13."""
    assert ReadEeprom(13, 0x200, 500).frame == b"#0DREE0020001F4\r"
    assert ReadEeprom(7, 0x200, 500).frame == b"#07REE0020001F4\r"


def test_writing_is_the_printed_request() -> None:
    """docs/protocol.md section 2: 12h 34h to 100h, station 22, count 02, checksum B7."""
    assert WriteEeprom(22, 0x100, b"\x12\x34").frame == b"#16WEE00100021234B7\r"


def test_writing_has_the_printed_checksum() -> None:
    """docs/protocol.md section 2: the checksum of address, count and data, FCh."""
    frame = WriteEeprom(1, 0, bytes.fromhex("1122334455")).frame
    assert frame == b"#01WEE00000051122334455FC\r"


def test_ok_is_the_reply_to_a_write() -> None:
    """`EE>OK` says that it was written."""
    request = WriteEeprom(22, 0x100, b"\x12\x34")
    all_ways(request, b"EE>OK\r")
    assert request.reply_chars == len(b"EE>OK\r")


@given(data=st.binary(min_size=1, max_size=300))
def test_a_read_returns_the_data(data: bytes) -> None:
    """The data come back as they are, without their checksum."""
    request = ReadEeprom(1, 0, len(data))
    assert request.reply_chars == len(eeprom(data))
    assert request.decode(eeprom(data)) == data


def test_a_read_returns_the_data_whatever_way_they_come() -> None:
    """Byte by byte, behind noise and before trailing bytes as well."""
    data = bytes(range(0xF0, 0x100))
    assert all_ways(ReadEeprom(1, 0, len(data)), eeprom(data)) == data


def test_the_whole_chip_can_be_read_at_once() -> None:
    """2048 bytes from 0 are inside the chip."""
    data = bytes(range(256)) * 8
    request = ReadEeprom(1, 0, 2048)
    assert request.frame == b"#01REE000000800\r"
    assert request.decode(eeprom(data)) == data


@pytest.mark.parametrize("body", ["1234BB", "1234bA", "1234", "123400", "12345678BA", "12 4BA"])
def test_a_wrong_checksum_or_form_is_a_bad_reply(body: str) -> None:
    """12h 34h sum to BAh short of 100h: anything else is not believed."""
    with pytest.raises(BadReplyError):
        all_ways(ReadEeprom(1, 0, 2), wisco("EE>", body))


def test_the_right_checksum_is_the_complement() -> None:
    """The same frame with BA is good."""
    assert all_ways(ReadEeprom(1, 0, 2), wisco("EE>", "1234BA")) == b"\x12\x34"


@pytest.mark.parametrize(
    ("address", "count"),
    [(-1, 1), (2048, 1), (0, 0), (0, 2049), (2047, 2), (0, -1), (0x200, 1537)],
)
def test_reads_stay_inside_the_chip(address: int, count: int) -> None:
    """Address and count inside 2048 bytes, at least one byte."""
    with pytest.raises(ValueError, match=r"address|count"):
        ReadEeprom(1, address, count)


@pytest.mark.parametrize(
    ("address", "size"), [(-1, 1), (2048, 1), (0, 0), (0, 256), (2047, 2), (1900, 149)]
)
def test_writes_stay_inside_the_chip(address: int, size: int) -> None:
    """A write past the end of the EEPROM, or with more than 255 bytes, is refused."""
    with pytest.raises(ValueError, match=r"address|count"):
        WriteEeprom(1, address, bytes(size))


def test_the_edges_of_a_write_are_valid() -> None:
    """255 bytes, and the last byte of the chip."""
    assert WriteEeprom(1, 0, bytes(255)).frame.startswith(b"#01WEE00000FF00")
    assert WriteEeprom(1, 2047, b"\x01").frame == b"#01WEE007FF0101F8\r"


@pytest.mark.parametrize("address", [-1, 32])
def test_stations_run_from_0_to_31(address: int) -> None:
    """A station that the DIP switches cannot say is refused."""
    with pytest.raises(ValueError, match="station"):
        ReadEeprom(address, 0, 1)
    with pytest.raises(ValueError, match="station"):
        WriteEeprom(address, 0, b"\x00")
