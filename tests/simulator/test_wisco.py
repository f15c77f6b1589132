"""Wisco frames: every one that docs/protocol.md section 2 prints, and every error code."""

import pytest

from bridge.model import DIO100, DO100, ModuleType
from bridge.simulator import SimulatedModule
from bridge.simulator.wisco import answer


def module_with(
    model: ModuleType, address: int, *, inputs: int = 0, outputs: int = 0
) -> SimulatedModule:
    """A module whose channels are as given."""
    module = SimulatedModule(model, address)
    for channel in range(1, model.inputs + 1):
        module.set_input(channel, bool(inputs >> (channel - 1) & 1))
    for channel in range(1, model.outputs + 1):
        module.set_output(channel, bool(outputs >> (channel - 1) & 1))
    return module


@pytest.mark.parametrize(
    ("frame", "module", "reply"),
    [
        (b"#01RDI\r", module_with(DIO100, 1, inputs=0x9EAB), b"DI>1001111010101011\r"),
        (b"#04RDIH\r", module_with(DIO100, 4, inputs=0x9EAB), b"DI>9EAB\r"),
        (b"#07RDO\r", module_with(DIO100, 7, outputs=0xD2), b"DO>11010010\r"),
        (b"#07RDO\r", module_with(DO100, 7, outputs=0xD56A), b"DO>1101010101101010\r"),
        (b"#0ARDOH\r", module_with(DIO100, 10, outputs=0xD2), b"DO>D2\r"),
        (b"#0ARDOH\r", module_with(DO100, 10, outputs=0xD56A), b"DO>D56A\r"),
        (b"#00RDOH\r", module_with(DO100, 0, outputs=0x1), b"DO>0001\r"),
    ],
)
def test_reads(frame: bytes, module: SimulatedModule, reply: bytes) -> None:
    """The manual's read frames get the manual's replies; station 0 is a station."""
    assert answer(module, frame) == reply


@pytest.mark.parametrize(
    ("frame", "module", "outputs"),
    [
        (b"#10WDO124,010\r", module_with(DIO100, 16, outputs=0x81), 0x82),
        (b"#10WDO124,010\r", module_with(DO100, 16, outputs=0xFF0F), 0xFF06),
        (b"#13WDOX73,72\r", module_with(DIO100, 19, outputs=0x89), 0xFA),
        (b"#0DWDOX8B73,8B72\r", module_with(DO100, 13, outputs=0x7401), 0xFF72),
        # The scan prints station 01 here; a value outside the mask counts for nothing.
        (b"#01WDOX01,FF\r", module_with(DIO100, 1), 0x01),
        (b"#01WDOX00,FF\r", module_with(DIO100, 1), 0x00),
    ],
)
def test_writes(frame: bytes, module: SimulatedModule, outputs: int) -> None:
    """The manual's write frames switch what they name and leave the rest."""
    assert answer(module, frame) == b"DO>OK\r"
    assert module.outputs == outputs


def test_masked_write_names_each_output_once() -> None:
    """`0DWDOX8B73,8B72`: 16, 12, 10, 9, 7, 6, 5, 2 ON and 1 OFF, as the manual says."""
    module = SimulatedModule(DO100, 13)
    answer(module, b"#0DWDOX8B73,8B72\r")
    on = {(output, True): 1 for output in (16, 12, 10, 9, 7, 6, 5, 2)}
    assert module.ordered == {**on, (1, False): 1}


def test_eeprom_read() -> None:
    """500 bytes from 200h come back in hex with the checksum of the data bytes."""
    module = SimulatedModule(DO100, 13)
    module.write_eeprom(0x200, bytes(range(250)) * 2)
    reply = answer(module, b"#0DREE0020001F4\r")
    data = (bytes(range(250)) * 2).hex().upper()
    low = sum(range(250)) * 2 % 256
    assert reply == f"EE>{data}{(256 - low) % 256:02X}\r".encode()


def test_whole_eeprom_in_one_read() -> None:
    """All 2048 bytes fit into one reply."""
    reply = answer(SimulatedModule(DIO100, 1), b"#01REE000000800\r")
    assert reply is not None
    assert len(reply) == len("EE>") + 2 * 2048 + len("CS\r")


def test_eeprom_write() -> None:
    """The frame of the manual writes 12 34 to 100h; its checksum B7 fits count 02 alone."""
    module = SimulatedModule(DIO100, 22)
    assert answer(module, b"#16WEE00100021234B7\r") == b"EE>OK\r"
    assert module.read_eeprom(0x100, 2) == b"\x12\x34"
    assert answer(module, b"#16WEE00100031234B7\r") == b"ERR=6\r"


def test_longest_eeprom_write() -> None:
    """255 bytes, the most that two digits can say, are taken in one frame."""
    module = SimulatedModule(DIO100, 1)
    body = bytes([0x00, 0x00, 0xFF, *[0x01] * 255])
    frame = f"#01WEE0{body.hex().upper()}{(-sum(body)) % 256:02X}\r".encode()
    assert answer(module, frame) == b"EE>OK\r"
    assert module.read_eeprom(0, 256) == b"\x01" * 255 + b"\xff"


@pytest.mark.parametrize(
    "frame", [b"#02RDI\r", b"#1\r", b"#\r", b"#0aRDI\r", b"#FFRDI\r", b"# 1RDI\r", b"#+1RDI\r"]
)
def test_silent_when_not_called(frame: bytes) -> None:
    """Another address, a damaged one, or lower-case digits: nothing is said."""
    for address in (1, 10):
        assert answer(SimulatedModule(DIO100, address), frame) is None


@pytest.mark.parametrize(
    ("code", "model", "command"),
    [
        (1, DO100, b"RDI"),
        (1, DO100, b"RDIH"),
        (1, DIO100, b"RDX"),
        (1, DIO100, b""),
        (1, DIO100, b"rdi"),
        (1, DIO100, b"R\xffI"),
        (2, DIO100, b"WDO9,1"),
        (2, DO100, b"WDO0,1"),
        (2, DIO100, b"REE007FF0002"),
        (2, DIO100, b"REE100000001"),
        (2, DIO100, b"WEE007FF021234B2"),
        (3, DIO100, b"WDO12,02"),
        (4, DIO100, b"WDO124010"),
        (4, DIO100, b"WDO,"),
        (4, DIO100, b"WDO12,1"),
        (4, DIO100, b"WDOX7372"),
        (4, DIO100, b"WDOX0073,0072"),
        (4, DO100, b"WDOX73,72"),
        (4, DIO100, b"WDOX7G,72"),
        (4, DIO100, b"REE00000001"),
        (4, DIO100, b"REE0000000010"),
        (4, DIO100, b"WEE0"),
        (4, DIO100, b"WEE001000212g4B7"),
        (5, DIO100, b"WEE00100021234B8"),
        (6, DIO100, b"WEE0010002123456B7"),
        (6, DIO100, b"REE000000000"),
        (6, DIO100, b"WEE0010000FF"),
    ],
)
def test_errors(code: int, model: ModuleType, command: bytes) -> None:
    """A wrong request gets its code and does nothing."""
    module = module_with(model, 1, outputs=0x5A)
    before = module.read_eeprom(0, 2048)
    assert answer(module, b"#01" + command + b"\r") == b"ERR=%d\r" % code
    assert module.outputs == 0x5A
    assert module.read_eeprom(0, 2048) == before
    assert not module.ordered
