"""Builds replies on its own, from docs/protocol.md, so that no codec checks itself."""


def wisco(kind: str, body: str) -> bytes:
    """A Wisco reply: kind, body, CR."""
    return f"{kind}{body}\r".encode()


def eeprom(data: bytes) -> bytes:
    """The reply to REE: the data and the two's complement of their sum."""
    checksum = (0x100 - sum(data) % 0x100) % 0x100
    return wisco("EE>", "".join(f"{byte:02X}" for byte in (*data, checksum)))


def rtu(*body: int) -> bytes:
    """Station and PDU with their CRC, worked out bit by bit as a polynomial division."""
    crc = 0xFFFF
    for byte in body:
        crc ^= byte
        for _ in range(8):
            carry, crc = crc % 2, crc // 2
            if carry:
                crc ^= 0xA001
    return bytes([*body, crc % 0x100, crc // 0x100])


def ascii_frame(*body: int) -> bytes:
    """Station and PDU with their LRC, in upper-case hex between colon and CR LF."""
    checksum = (0x100 - sum(body) % 0x100) % 0x100
    return f":{''.join(f'{byte:02X}' for byte in (*body, checksum))}\r\n".encode()
