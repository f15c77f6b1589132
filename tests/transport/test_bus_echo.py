from collections.abc import Callable

import pytest
from support.virtual_port import Chunk, Transcript, VirtualPort, VirtualTime

from bridge.config.schema import LineConfig
from bridge.errors import BadReplyError, ExchangeError, NoReplyError, RefusedError
from bridge.model import LineProtocol
from bridge.protocol.ascii import AsciiRequest
from bridge.protocol.modbus import Pdu, ReadDiscreteInputs, WriteCoil, WriteCoils, WriteRegister
from bridge.protocol.request import Request
from bridge.protocol.rtu import RtuRequest
from bridge.protocol.wisco import ReadInputsHex
from bridge.transport.bus import Bus
from bridge.transport.timing import LineTiming

Frame = Callable[[int, Pdu[None]], Request[None]]

RTU_READ = RtuRequest(1, ReadDiscreteInputs(0, 16))
RTU_REPLY = bytes.fromhex("01 02 02 AB 9E 47 20")
ASCII_READ = AsciiRequest(1, ReadDiscreteInputs(0, 16))
READS: list[tuple[Request[int], bytes]] = [
    (RTU_READ, RTU_REPLY),
    (ASCII_READ, b":010202AB9EB2\r\n"),
    (ReadInputsHex(1), b"DI>9EAB\r"),
]
VALUE = 0x9EAB
SWITCH_ON = WriteCoil(3, on=True)
EQUAL_WRITES = [SWITCH_ON, WriteCoil(3, on=False), WriteRegister(1, 25)]

reads = pytest.mark.parametrize(("read", "reply"), READS, ids=["rtu", "ascii", "wisco"])
frames = pytest.mark.parametrize("frame", [RtuRequest, AsciiRequest], ids=["rtu", "ascii"])


def bus_with(*lines: tuple[bytes, list[Chunk]]) -> Bus:
    """A bus in virtual time on which these requests bring these replies."""
    time = VirtualTime()
    line = LineConfig("main", "virtual", 9600, LineProtocol.MODBUS_RTU, stations=())
    port = VirtualPort(time, Transcript(*lines))
    return Bus(port, LineTiming.from_config(line), 0.3, time.clock, time.sleep)


def echoing(request: Request[object], reply: bytes = b"") -> tuple[bytes, list[Chunk]]:
    """Return our own frame, then the reply if there is a module."""
    return request.frame, [(0.009, request.frame), (0.020, reply)]


def plain(request: Request[object], reply: bytes) -> tuple[bytes, list[Chunk]]:
    """These bytes alone come back."""
    return request.frame, [(0.020, reply)]


@reads
@pytest.mark.parametrize("echo", [True, False])
def test_a_read_shows_whether_the_line_echoes(read: Request[int], reply: bytes, echo: bool) -> None:
    """Our frame before the reply tells an echo, a valid reply alone none; the value is right."""
    line = (echoing if echo else plain)(read, reply)
    bus = bus_with(line, line)
    assert bus.exchange(read, protected=True) == VALUE
    assert bus.echo is echo
    assert bus.exchange(read, protected=True) == VALUE


@reads
def test_a_dead_station_shows_the_echo_too(read: Request[int], reply: bytes) -> None:
    """The echo of an unanswered read is no reply, known or not."""
    bus = bus_with(echoing(read), echoing(read), echoing(read, reply))
    for _ in range(2):
        with pytest.raises(NoReplyError):
            bus.exchange(read, protected=True)
        assert bus.echo is True
    assert bus.exchange(read, protected=True) == VALUE


@pytest.mark.parametrize(
    ("before", "echo"), [(b"\x00", False), (b"\x11" + RTU_READ.frame[1:], None)]
)
def test_a_stray_byte_is_no_echo_and_a_damaged_one_decides_nothing(
    before: bytes, echo: bool | None
) -> None:
    """A reply behind a damaged echo must not make the line pass for one without echo."""
    bus = bus_with(plain(RTU_READ, before + RTU_REPLY))
    assert bus.exchange(RTU_READ, protected=True) == VALUE
    assert bus.echo is echo


def test_silence_and_refusals_decide_nothing() -> None:
    """Without an echo or a good reply the question stays open."""
    bus = bus_with(plain(RTU_READ, b""), plain(RTU_READ, bytes.fromhex("01 82 01 81 60")))
    with pytest.raises(NoReplyError):
        bus.exchange(RTU_READ, protected=True)
    with pytest.raises(RefusedError):
        bus.exchange(RTU_READ, protected=True)
    assert bus.echo is None


@frames
@pytest.mark.parametrize("pdu", EQUAL_WRITES)
def test_a_write_to_a_dead_station_behind_an_echo(frame: Frame, pdu: Pdu[None]) -> None:
    """On a line known to echo, the echo of a write never passes for its acknowledgement."""
    write = frame(1, pdu)
    bus = bus_with(echoing(RTU_READ, RTU_REPLY), *[echoing(write)] * 20, echoing(write))
    bus.exchange(RTU_READ, protected=True)
    for _ in range(20):
        with pytest.raises(NoReplyError):
            bus.exchange(write, protected=True)
    assert bus.counters.good == 1


@frames
@pytest.mark.parametrize("pdu", EQUAL_WRITES)
def test_a_write_to_a_live_station_behind_an_echo(frame: Frame, pdu: Pdu[None]) -> None:
    """On a line known to echo, a live station's acknowledgement is always found."""
    write = frame(1, pdu)
    bus = bus_with(echoing(RTU_READ, RTU_REPLY), *[echoing(write, write.frame)] * 20)
    bus.exchange(RTU_READ, protected=True)
    for _ in range(20):
        bus.exchange(write, protected=True)
    assert bus.counters.good == 21


@frames
def test_a_write_on_a_line_without_echo(frame: Frame) -> None:
    """After a read without an echo, an equal reply to a write is the acknowledgement."""
    write = frame(1, SWITCH_ON)
    bus = bus_with(plain(RTU_READ, RTU_REPLY), plain(write, write.frame))
    bus.exchange(RTU_READ, protected=True)
    bus.exchange(write, protected=True)
    assert bus.counters.good == 2


@frames
@pytest.mark.parametrize(
    ("noise", "times", "error", "told"),
    [
        (b"", 1, BadReplyError, "an echo or the reply"),
        (b"\x00", 1, BadReplyError, "an echo or the reply"),
        (b"", 0, NoReplyError, "did not answer"),
    ],
)
def test_no_reply_to_a_write_before_any_read(
    frame: Frame, noise: bytes, times: int, error: type[ExchangeError], told: str
) -> None:
    """Our own bytes once, also behind a stray one, or nothing: neither a success nor a proof."""
    write = frame(1, SWITCH_ON)
    bus = bus_with(plain(write, noise + times * write.frame))
    with pytest.raises(error, match=told):
        bus.exchange(write, protected=True)
    assert bus.echo is None


@frames
def test_two_frames_back_before_any_read(frame: Frame) -> None:
    """Our own bytes twice are echo and reply: success, and still for a read to decide."""
    write = frame(1, SWITCH_ON)
    bus = bus_with(echoing(write, write.frame))
    bus.exchange(write, protected=True)
    assert bus.counters.good == 1
    assert bus.echo is None


def test_a_refused_write_before_any_read() -> None:
    """A refusal equals no request, so it is believed at once."""
    write = RtuRequest(1, SWITCH_ON)
    bus = bus_with(plain(write, bytes.fromhex("01 85 02 C3 51")))
    with pytest.raises(RefusedError):
        bus.exchange(write, protected=True)


@pytest.mark.parametrize("echo", [True, None])
def test_no_flipped_bit_makes_an_echo_a_success(echo: bool | None) -> None:
    """Whichever bit of the echo is damaged: a dead station's write never succeeds."""
    write = RtuRequest(1, SWITCH_ON)
    for bit in range(8 * len(write.frame)):
        damaged = bytearray(write.frame)
        damaged[bit // 8] ^= 1 << bit % 8
        bus = bus_with(plain(write, bytes(damaged)))
        bus.echo = echo
        with pytest.raises(ExchangeError):
            bus.exchange(write, protected=True)


def test_a_write_whose_reply_begins_like_it() -> None:
    """FC15 is answered with its own first six bytes: that is no half an echo."""
    write = RtuRequest(1, WriteCoils(0, 8, 0x72))
    reply = bytes.fromhex("01 0F 00 00 00 08 54 0D")
    for line, echo in ((plain(write, reply), False), (echoing(write, reply), True)):
        bus = bus_with(line)
        bus.exchange(write, protected=True)
        assert bus.echo is echo


@pytest.mark.parametrize("came", [b"\x02", RTU_READ.frame[:5], RTU_REPLY, b"\x00" * 8])
def test_an_echo_that_differs(came: bytes) -> None:
    """On a line known to echo, anything but our exact frame is a collision, with its bytes."""
    bus = bus_with(echoing(RTU_READ, RTU_REPLY), plain(RTU_READ, came))
    bus.exchange(RTU_READ, protected=True)
    with pytest.raises(BadReplyError, match="the echo differs") as caught:
        bus.exchange(RTU_READ, protected=True)
    assert caught.value.data == came
    assert bus.echo is True


def test_an_echo_that_stops_before_any_read() -> None:
    """Half an echo and nothing more is an incomplete reply."""
    bus = bus_with(plain(RTU_READ, RTU_READ.frame[:6]))
    with pytest.raises(BadReplyError):
        bus.exchange(RTU_READ, protected=True)
    assert bus.echo is None
