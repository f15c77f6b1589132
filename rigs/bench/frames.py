"""The requests of the bare loop, put together with the simulator's own sums."""

from bridge.simulator import modbus


def reads_of(protocol: str, address: int) -> tuple[tuple[bytes, int], ...]:
    """Inputs, then outputs of a DIO100: each request with the length of its reply."""
    if protocol == "wisco":
        return (b"#%02XRDIH\r" % address, 8), (b"#%02XRDOH\r" % address, 6)
    inputs = bytes([address, 2, 0, 0, 0, 16])
    outputs = bytes([address, 1, 0, 0, 0, 8])
    if protocol == "modbus-rtu":
        return (inputs + modbus.crc(inputs), 7), (outputs + modbus.crc(outputs), 6)
    return (_ascii(inputs), 15), (_ascii(outputs), 13)


def _ascii(body: bytes) -> bytes:
    return b":%s%02X\r\n" % (body.hex().upper().encode(), modbus.lrc(body))
