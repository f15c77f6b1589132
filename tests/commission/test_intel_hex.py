"""Intel HEX: what is written reads back, and what is wrong is told with its line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.commission.intel_hex import format_hex, parse_hex

END = ":00000001FF\n"


@given(st.binary(max_size=2048))
def test_what_is_written_reads_back(data: bytes) -> None:
    """Every byte comes back at its own address, and the remark beside them."""
    parsed = parse_hex(format_hex(data, "a remark"))
    assert (parsed.content, parsed.remarks) == (dict(enumerate(data)), ("a remark",))


def test_records_are_the_well_known_ones() -> None:
    """A record of 16 bytes, a shorter last one, the end; behind that, for us alone, the remark."""
    data = bytes.fromhex("214601360121470136007EFE09D21901 2146")
    records = ":10000000214601360121470136007EFE09D2190141\n:02001000214687\n" + END
    assert format_hex(data, "a remark") == records + "; a remark\n"


def test_a_record_of_other_tools_is_read() -> None:
    """Others write lower case, CR LF, blank lines, base records of 0 and a start record."""
    text = ":020000040000fa\r\n:0300300002337a1e\r\n\r\n:0400000500000000f7\r\n:00000001ff\r\n\r\n"
    assert parse_hex(text).content == {0x30: 0x02, 0x31: 0x33, 0x32: 0x7A}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("hello\n", "line 1: a record is a colon"),
        (":0300300002337A1F\n", "line 1: checksum 1F stands where 1E is due"),
        (f":0300300002337A1E\n:0200300002337A1F\n{END}", "line 2: the byte count"),
        (":00\n", "line 1: the byte count"),
        (":0300300002337A1E\n", "the end record :00000001FF is missing"),
        ("", "the end record :00000001FF is missing"),
        (f":020000040001F9\n{END}", "line 1: an address above FFFFh"),
        (f":0000000AF6\n{END}", "line 1: there is no record type 0A"),
        (f":0100000001FE\n:0100000002FD\n{END}", "line 2: address 0000 stands twice"),
        (f"{END}:0100000001FE\n{END}", "line 2: this stands behind the end record"),
        (f":0100000001FE\n{END}\n; a remark\nhello\n", "line 5: this stands behind the end record"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(text: str, complaint: str) -> None:
    """A damaged file is never taken for a smaller image."""
    with pytest.raises(ValueError, match="^" + complaint.replace("(", r"\(")):
        parse_hex(text)
