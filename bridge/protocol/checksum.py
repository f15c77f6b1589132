"""Checksums of frames: CRC-16 (Modbus RTU), LRC (Modbus ASCII), and that of Wisco EEPROM frames."""

_CRC_POLYNOMIAL = 0xA001  # of CRC-16/MODBUS, with its bits reversed: the low bit goes first
_CRC_START = 0xFFFF
_BITS_PER_BYTE = 8


def _crc_of_byte(byte: int) -> int:
    crc = byte
    for _ in range(_BITS_PER_BYTE):
        crc = (crc >> 1) ^ _CRC_POLYNOMIAL if crc & 1 else crc >> 1
    return crc


_CRC_TABLE = tuple(_crc_of_byte(byte) for byte in range(256))


def crc16(data: bytes) -> int:
    """Return the CRC, which is sent low byte first.

    The CRC over a frame that ends with its own CRC is 0.
    """
    crc = _CRC_START
    for byte in data:
        crc = (crc >> 8) ^ _CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


def lrc(data: bytes) -> int:
    """Return the two's complement of the sum of the bytes (docs/protocol.md section 3).

    The LRC over bytes that end with their own LRC is 0.
    """
    return -sum(data) & 0xFF


def wisco_checksum(data: bytes) -> int:
    """Return the checksum of EEPROM frames (docs/protocol.md section 2). It equals the LRC."""
    return lrc(data)
