"""Intel HEX text, as far as an EEPROM needs it: 16-bit addresses, data and end records.

The format has no comments, and its readers (objcopy, avrdude, the intelhex package of Python) stop
at the end record. So a remark follows the end record, in a line that begins with `;`.

It is written here because the format is small and has not changed since 1988, and the common
library had its last release in 2020 (docs/architecture.md, Dependencies).
"""

from collections.abc import Mapping
from dataclasses import dataclass

_DATA, _END = 0x00, 0x01
_START_RECORDS = (0x03, 0x05)  # the start of a program, which an EEPROM does not have
_BASE_RECORDS = (0x02, 0x04)  # address bits above the 16 of a record
_AROUND_BYTES = 5  # count, address (2), type, checksum
_RECORD_BYTES = 16
_REMARK = ";"
_HEX_DIGITS = frozenset("0123456789ABCDEFabcdef")


@dataclass(frozen=True, slots=True)
class HexText:
    """The content of a text.

    Attributes:
        content: The bytes by address.
        remarks: The lines after the end record, without their semicolons.
    """

    content: Mapping[int, int]
    remarks: tuple[str, ...]


def format_hex(data: bytes, remark: str) -> str:
    """Return a text with the bytes from address 0 on, 16 in a record, and a remark."""
    starts = range(0, len(data), _RECORD_BYTES)
    records = [_record(at, _DATA, data[at : at + _RECORD_BYTES]) for at in starts]
    return "\n".join([*records, _record(0, _END, b""), f"{_REMARK} {remark}"]) + "\n"


def parse_hex(text: str) -> HexText:
    """Return the content of a text.

    Raises:
        ValueError: With the line, and what is wrong there.
    """
    found: dict[int, int] = {}
    remarks: list[str] | None = None  # set by the end record
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        try:
            if line and remarks is not None:
                remarks.append(_remark(line))
            elif line:
                kind, address, data = _open(line)
                if kind == _END:
                    remarks = []
                else:
                    _take(found, kind, address, data)
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None
    if remarks is None:
        raise ValueError("the end record :00000001FF is missing: the file is cut off")
    return HexText(found, tuple(remarks))


def _remark(line: str) -> str:
    if not line.startswith(_REMARK):
        raise ValueError("this stands behind the end record: are these two files in one?")
    return line.removeprefix(_REMARK).strip()


def _record(address: int, kind: int, data: bytes) -> str:
    content = bytes([len(data)]) + address.to_bytes(2, "big") + bytes([kind]) + data
    return f":{content.hex().upper()}{-sum(content) & 0xFF:02X}"


def _open(line: str) -> tuple[int, int, bytes]:
    """Return type, address and data of one record, or raise ValueError."""
    if not line.startswith(":") or not _HEX_DIGITS.issuperset(line[1:]) or len(line) % 2 == 0:
        raise ValueError("a record is a colon and pairs of hex digits")
    content = bytes.fromhex(line[1:])
    if len(content) < _AROUND_BYTES or content[0] != len(content) - _AROUND_BYTES:
        raise ValueError("the byte count does not match the record's length")
    if sum(content) & 0xFF:
        due = -sum(content[:-1]) & 0xFF
        raise ValueError(f"checksum {content[-1]:02X} stands where {due:02X} is due")
    return content[3], int.from_bytes(content[1:3], "big"), content[4:-1]


def _take(found: dict[int, int], kind: int, address: int, data: bytes) -> None:
    if kind in _START_RECORDS:
        return
    if kind in _BASE_RECORDS:
        if any(data):
            raise ValueError("an address above FFFFh: this is no image of the EEPROM")
        return
    if kind != _DATA:
        raise ValueError(f"there is no record type {kind:02X}")
    for at, byte in enumerate(data, address):
        if found.setdefault(at, byte) != byte:
            raise ValueError(f"address {at:04X} stands twice, with different values")
