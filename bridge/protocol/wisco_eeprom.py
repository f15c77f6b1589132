"""Wisco frames for the EEPROM: REE and WEE, with the checksum (docs/protocol.md section 2)."""

from bridge.protocol.checks import exactly_hex, in_range
from bridge.protocol.checksum import wisco_checksum
from bridge.protocol.wisco import EEPROM, WiscoRequest, WiscoWrite, request_frame

EEPROM_BYTES = 2048
MAX_WRITE_BYTES = 255  # the count is two hex digits
_CHIP = "0"  # the modules have one EEPROM, and that is its number


class ReadEeprom(WiscoRequest[bytes]):
    """REE: `count` bytes from `start` on."""

    __slots__ = ()

    def __init__(self, address: int, start: int, count: int) -> None:
        _check_span(start, count, EEPROM_BYTES)
        frame = request_frame(address, f"REE{_CHIP}{start:04X}{count:04X}")
        super().__init__(address, frame, EEPROM, 2 * count + 2)

    def value(self, body: bytes) -> bytes:
        """Return the data. We take the checksum as covering only the data (section 2)."""
        text = exactly_hex(body, self.body_chars)
        *data, checksum = bytes.fromhex(text.decode("ascii"))
        due = wisco_checksum(bytes(data))
        if checksum != due:
            raise ValueError(f"checksum {checksum:02X} came where {due:02X} is due")
        return bytes(data)


class WriteEeprom(WiscoWrite):
    """WEE: `data` from `start` on. Wears the EEPROM."""

    __slots__ = ()

    def __init__(self, address: int, start: int, data: bytes) -> None:
        _check_span(start, len(data), MAX_WRITE_BYTES)
        # docs/protocol.md section 2: the checksum covers address, count and data.
        content = start.to_bytes(2, "big") + bytes([len(data)]) + data
        checksum = wisco_checksum(content)
        super().__init__(address, f"WEE{_CHIP}{content.hex().upper()}{checksum:02X}", EEPROM)


def _check_span(start: int, count: int, most: int) -> None:
    in_range("EEPROM address", start, 0, EEPROM_BYTES - 1)
    in_range("byte count", count, 1, min(most, EEPROM_BYTES - start))
