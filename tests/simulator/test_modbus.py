"""Modbus: every frame that docs/protocol.md section 4 prints, and the exceptions."""

import pytest

from bridge.model import DIO100, DO100, ModuleType
from bridge.simulator import SimulatedModule
from bridge.simulator.modbus import answer_ascii, answer_rtu, crc, lrc

# station, model, request and reply of each row of docs/protocol.md section 4, RTU and ASCII
EXCHANGES = [
    ("01 02 00 00 00 10 79 C6", "01 02 02 AB 9E 47 20", ":010200000010ED", ":010202AB9EB2"),
    ("01 01 00 00 00 08 3D CC", "01 01 01 D2 D1 D5", ":010100000008F6", ":010101D22B"),
    ("01 05 00 03 FF 00 7C 3A", "01 05 00 03 FF 00 7C 3A", ":01050003FF00F8", ":01050003FF00F8"),
    ("01 05 00 03 00 00 3D CA", "01 05 00 03 00 00 3D CA", ":010500030000F7", ":010500030000F7"),
    (
        "01 0F 00 00 00 08 01 72 7E B0",
        "01 0F 00 00 00 08 54 0D",
        ":010F00000008017275",
        ":010F00000008E8",
    ),
    ("01 06 00 01 00 19 19 C0", "01 06 00 01 00 19 19 C0", ":010600010019DF", ":010600010019DF"),
    (
        "01 10 00 00 00 02 04 00 01 00 19 63 A5",
        "01 10 00 00 00 02 41 C8",
        ":0110000000020400010019CF",
        ":011000000002ED",
    ),
]


def dio100() -> SimulatedModule:
    """Station 1 with the inputs and outputs of section 4's replies."""
    module = SimulatedModule(DIO100, 1)
    for channel in range(1, 17):
        module.set_input(channel, bool(0x9EAB >> (channel - 1) & 1))
    for channel in range(1, 9):
        module.set_output(channel, bool(0xD2 >> (channel - 1) & 1))
    return module


def ascii_frame(text: str) -> bytes:
    """A frame as it goes on the wire."""
    return text.encode() + b"\r\n"


@pytest.mark.parametrize(("rtu", "rtu_reply", "text", "text_reply"), EXCHANGES)
def test_printed_exchanges(rtu: str, rtu_reply: str, text: str, text_reply: str) -> None:
    """Each request of section 4 gets the reply printed there, over RTU and ASCII alike."""
    assert answer_rtu(dio100(), bytes.fromhex(rtu)) == bytes.fromhex(rtu_reply)
    assert answer_ascii(dio100(), ascii_frame(text)) == ascii_frame(text_reply)


def test_coils_are_switched() -> None:
    """FC05 switches the one output, FC15 all that it names, low bit first."""
    module = dio100()
    answer_rtu(module, bytes.fromhex("01 05 00 03 FF 00 7C 3A"))
    assert module.outputs == 0xDA
    answer_rtu(module, bytes.fromhex("01 05 00 03 00 00 3D CA"))
    assert module.outputs == 0xD2
    answer_ascii(module, ascii_frame(":010F00000008017275"))
    assert module.outputs == 0x72


def test_coils_of_a_do100() -> None:
    """Station 13: outputs 1-16 = 8B72h."""
    for by_rtu in (True, False):
        module = SimulatedModule(DO100, 13)
        if by_rtu:
            frame = bytes.fromhex("0D 0F 00 00 00 10 02 72 8B D3 E7")
            reply = answer_rtu(module, frame)
            assert reply is not None
            assert reply[:6] == bytes.fromhex("0D 0F 00 00 00 10")
        else:
            frame = ascii_frame(":0D0F0000001002728BD5")
            assert answer_ascii(module, frame) == ascii_frame(":0D0F00000010D4")
        assert module.outputs == 0x8B72
        assert all(each.frame == frame for each in module.switchings)


def test_coils_in_the_middle() -> None:
    """The manual's `:010100020005F7` reads outputs 3-7."""
    reply = answer_ascii(dio100(), ascii_frame(":010100020005F7"))
    assert reply == ascii_frame(":01010114E9")  # D2h is 1101 0010: outputs 7-3 are 10100


def test_registers_are_read() -> None:
    """Mode and hold times come as nine registers; the mode's high byte is anything."""
    module = dio100()
    module.set_mode(1, pulse=True, hold_s=2.5)
    rtu = answer_rtu(module, bytes.fromhex("01 03 00 00 00 09 85 CC"))
    text = answer_ascii(module, ascii_frame(":010300000009F3"))
    assert rtu is not None
    assert text is not None
    for reply in (rtu, bytes.fromhex(text[1:-2].decode())):
        assert reply[:3] == bytes.fromhex("01 03 12")
        assert reply[4:7] == bytes.fromhex("01 00 19")
        assert reply[7:21] == bytes.fromhex("00 0A") * 7


def test_registers_are_written() -> None:
    """FC06 sets one hold time, FC16 mode and hold time together; both live in EEPROM."""
    module = dio100()
    answer_rtu(module, bytes.fromhex("01 06 00 01 00 19 19 C0"))
    assert module.settings.hold_ds[0] == 25
    assert module.settings.pulse == 0
    answer_rtu(module, bytes.fromhex("01 10 00 00 00 02 04 00 01 00 19 63 A5"))
    assert module.settings.pulse == 1
    assert module.eeprom_writes == 2


def test_reply_printed_for_station_9() -> None:
    """`:091000000004E3` is the answer to writing four registers of station 9."""
    body = "09" + "10" + "0000" + "0004" + "08" + "00FF" + "0001" + "0002" + "00FF"
    frame = f":{body}{lrc(bytes.fromhex(body)):02X}"
    module = SimulatedModule(DO100, 9)
    assert answer_ascii(module, ascii_frame(frame)) == ascii_frame(":091000000004E3")
    assert module.settings.pulse == 0xFF
    assert module.settings.hold_ds[:3] == (1, 2, 255)


def test_lrc_example_is_understood_and_refused() -> None:
    """`:1C06000201E5F6` has a good LRC, and asks for a hold time of 485: exception 03."""
    module = SimulatedModule(DIO100, 0x1C)
    assert answer_ascii(module, ascii_frame(":1C06000201E5F6")) == ascii_frame(":1C86035B")
    # The other scan prints E6 for its LRC, which is wrong.
    assert answer_ascii(module, ascii_frame(":1C06000201E5E6")) is None


def test_printed_exceptions() -> None:
    """Inputs of a DO100 are 01, an address past the end is 02, as section 4 prints them."""
    module = SimulatedModule(DO100, 1)
    inputs = bytes.fromhex("01 02 00 00 00 10 79 C6")
    assert answer_rtu(module, inputs) == bytes.fromhex("01 82 01 81 60")
    assert answer_ascii(module, ascii_frame(":010200000010ED")) == ascii_frame(":0182017C")
    coils = bytes.fromhex("01 01 00 10 00 01")
    assert answer_rtu(module, coils + crc(coils)) == bytes.fromhex("01 81 02 C1 91")
    assert answer_ascii(module, ascii_frame(":010100100001ED")) == ascii_frame(":0181027C")


@pytest.mark.parametrize(
    ("code", "model", "pdu"),
    [
        (1, DIO100, "04 0000 0001"),
        (1, DIO100, "07"),
        (1, DIO100, "83 0000 0001"),
        (2, DIO100, "01 0008 0001"),
        (2, DIO100, "01 0000 0009"),
        (2, DIO100, "02 0000 0011"),
        (2, DIO100, "03 0009 0001"),
        (2, DO100, "03 0000 0012"),
        (2, DIO100, "05 0008 FF00"),
        (2, DIO100, "06 0009 0001"),
        (2, DIO100, "0F 0004 0005 01 1F"),
        (2, DIO100, "10 0008 0002 04 0001 0001"),
        (3, DIO100, "01 0000 0000"),
        (3, DIO100, "01 0000 07D1"),
        (3, DIO100, "03 0000 007E"),
        (3, DIO100, "01 0000"),
        (3, DIO100, "01 0000 0001 00"),
        (3, DIO100, "05 0000 0001"),
        (3, DIO100, "06 0001 0000"),
        (3, DIO100, "06 0001 0100"),
        (3, DIO100, "0F 0000 0008 02 FF FF"),
        (3, DIO100, "0F 0000 0008 01"),
        (3, DIO100, "10 0001 0002 04 0001 0000"),
        (3, DIO100, "10 0001 0002 03 0001 00"),
    ],
)
def test_exceptions(code: int, model: ModuleType, pdu: str) -> None:
    """A wrong request gets its exception and does nothing, not even in part."""
    module = SimulatedModule(model, 1)
    body = b"\x01" + bytes.fromhex(pdu)
    reply = bytes([1, body[1] | 0x80, code])
    assert answer_rtu(module, body + crc(body)) == reply + crc(reply)
    assert not module.switchings
    assert module.eeprom_writes == 0


@pytest.mark.parametrize(
    "frame",
    [
        b":010200000010EC\r\n",  # LRC
        b":0102000000100ED\r\n",  # odd
        b":01020000001gED\r\n",
        b":0102 0000010ED\r\n",
        b":01FF\r\n",
        b":\r\n",
        b":020200000010EC\r\n",  # station 2
    ],
)
def test_ascii_silence(frame: bytes) -> None:
    """Damaged frames and frames for others are not answered."""
    assert answer_ascii(dio100(), frame) is None


@pytest.mark.parametrize("frame", ["01 02 00 00 00 10 79 C7", "02 02 00 00 00 10 79 F5", "", "01"])
def test_rtu_silence(frame: str) -> None:
    """Damaged frames and frames for others are not answered."""
    assert answer_rtu(dio100(), bytes.fromhex(frame)) is None


@pytest.mark.parametrize("address", [0, 1])
def test_broadcast(address: int) -> None:
    """Address 0: a write is carried out, nothing replies, not even station 0."""
    module = SimulatedModule(DIO100, address)
    write = bytes.fromhex("00 05 00 03 FF 00")
    read = bytes.fromhex("00 01 00 00 00 08")
    assert answer_rtu(module, write + crc(write)) is None
    assert answer_rtu(module, read + crc(read)) is None
    assert module.outputs == 0b1000
