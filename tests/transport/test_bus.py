import random
from contextlib import nullcontext

import pytest
from support.virtual_port import Answer, Chunk, Transcript, VirtualPort, VirtualTime

from bridge.config.schema import LineConfig
from bridge.errors import BadReplyError, ExpiredError, NoReplyError, PortError, RefusedError
from bridge.model import DO100, LineProtocol
from bridge.protocol.ascii import AsciiRequest
from bridge.protocol.modbus import ReadDiscreteInputs
from bridge.protocol.rtu import RtuRequest
from bridge.protocol.wisco import ReadInputsHex, ReadOutputsHex
from bridge.transport.bus import Bus
from bridge.transport.timing import LineTiming

LATE_WINDOW_S = 0.3
CHAR_S = 1 / 960

RTU_READ = RtuRequest(1, ReadDiscreteInputs(0, 16))
RTU_REPLY = bytes.fromhex("01 02 02 AB 9E 47 20")
WISCO_READ = ReadInputsHex(4)
WISCO_REPLY = b"DI>9EAB\r"
VALUE = 0x9EAB


def bus_on(port: VirtualPort, protocol: LineProtocol, timeout_s: float | None = None) -> Bus:
    """A bus at 9600 baud in the port's virtual time."""
    line = LineConfig("main", "virtual", 9600, protocol, stations=(), timeout_s=timeout_s)
    timing = LineTiming.from_config(line)
    return Bus(port, timing, LATE_WINDOW_S, port.time.clock, port.time.sleep)


def rtu_bus(answer: Answer) -> tuple[Bus, VirtualPort]:
    """A line of RTU frames."""
    port = VirtualPort(VirtualTime(), answer)
    return bus_on(port, LineProtocol.MODBUS_RTU), port


def wisco_bus(answer: Answer) -> tuple[Bus, VirtualPort]:
    """A line of Wisco frames."""
    port = VirtualPort(VirtualTime(), answer)
    return bus_on(port, LineProtocol.WISCO), port


def wisco(*replies: list[Chunk]) -> Transcript:
    """Return the results of a WISCO_READ for each item."""
    return Transcript(*((WISCO_READ.frame, reply) for reply in replies))


def rtu(*replies: list[Chunk]) -> Transcript:
    """Return the results of an RTU_READ for each item."""
    return Transcript(*((RTU_READ.frame, reply) for reply in replies))


def test_rtu_silence_is_exact() -> None:
    """The next RTU request goes 3.5 characters after the last byte, no sooner and no later."""
    bus, port = rtu_bus(rtu([(0.020, RTU_REPLY)], [(0.020, RTU_REPLY)]))
    bus.exchange(RTU_READ, protected=True)
    bus.exchange(RTU_READ, protected=True)
    (first, _), (second, _) = port.sent
    assert second == pytest.approx(first + 0.020 + 3.5 * CHAR_S)


def test_silence_that_passed_anyway_is_not_kept_again() -> None:
    """A request after the end of the silence is sent at once."""
    bus, port = rtu_bus(rtu([(0.020, RTU_REPLY)], [(0.020, RTU_REPLY)]))
    bus.exchange(RTU_READ, protected=True)
    port.time.sleep(1.0)
    asked_at = port.time.now
    bus.exchange(RTU_READ, protected=True)
    assert port.sent[1][0] == asked_at


def test_wisco_needs_no_silence() -> None:
    """The next Wisco request goes at once."""
    bus, port = wisco_bus(wisco([(0.020, WISCO_REPLY)], [(0.020, WISCO_REPLY)]))
    bus.exchange(WISCO_READ, protected=False)
    bus.exchange(WISCO_READ, protected=False)
    assert port.sent[1][0] == pytest.approx(port.sent[0][0] + 0.020)


def test_silence_counts_from_the_end_of_our_own_frame() -> None:
    """After an unanswered request the silence starts where our last character left the wire."""
    other = RtuRequest(9, ReadDiscreteInputs(0, 16))
    port = VirtualPort(VirtualTime(), Transcript((RTU_READ.frame, []), (other.frame, [])))
    bus = bus_on(port, LineProtocol.MODBUS_RTU, timeout_s=0.001)
    for request in (RTU_READ, other):
        with pytest.raises(NoReplyError):
            bus.exchange(request, protected=True)
    (first, _), (second, _) = port.sent
    assert second == pytest.approx(first + (8 + 3.5) * CHAR_S)


def test_nobody_answers() -> None:
    """A silent station costs exactly the time-out, and the error names both."""
    bus, port = wisco_bus(wisco([]))
    with pytest.raises(NoReplyError, match=r"^station 4 did not answer within 0\.12 s$"):
        bus.exchange(WISCO_READ, protected=False)
    assert port.time.now == pytest.approx(port.sent[0][0] + 16 * CHAR_S + 0.005 + 0.1)
    assert bus.counters.silent == 1


def test_reply_that_stops_halfway() -> None:
    """A reply that does not end in time is a bad one, with its bytes as evidence."""
    bus, _ = wisco_bus(wisco([(0.010, b"DI>9")]))
    with pytest.raises(BadReplyError, match="did not finish") as caught:
        bus.exchange(WISCO_READ, protected=False)
    assert caught.value.data == b"DI>9"
    assert bus.counters.bad == 1


def test_refusal() -> None:
    """A valid no is counted as such, and nothing late is feared after it."""
    bus, port = wisco_bus(wisco([(0.010, b"ERR=1\r")], [(0.010, WISCO_REPLY)]))
    with pytest.raises(RefusedError):
        bus.exchange(WISCO_READ, protected=False)
    assert bus.counters.refused == 1
    bus.exchange(WISCO_READ, protected=False)
    assert port.sent[1][0] == pytest.approx(port.sent[0][0] + 0.010)


def test_garbage_is_drained_before_the_error_comes_back() -> None:
    """After garbage the line is read until it is quiet, and the next exchange starts clean."""
    garbage = bytes(range(0x80, 0x98))
    bus, port = rtu_bus(
        rtu([(0.010, garbage), (0.025, garbage), (0.040, garbage)], [(0.020, RTU_REPLY)])
    )
    with pytest.raises(BadReplyError):
        bus.exchange(RTU_READ, protected=True)
    assert port.discard() == b""
    assert bus.exchange(RTU_READ, protected=True) == VALUE
    assert bus.counters.unsolicited_bytes == 0


def test_line_that_never_falls_quiet() -> None:
    """A line full of noise holds the thread no longer than time-out and drain."""
    noise = [(0.001 * n, b"\x55") for n in range(1, 2000)]
    bus, port = rtu_bus(rtu(noise))
    with pytest.raises(BadReplyError):
        bus.exchange(RTU_READ, protected=True)
    assert port.time.now - port.sent[0][0] < 0.4


def test_bytes_that_nobody_asked_for() -> None:
    """Bytes in the input before a request are counted and not taken as its reply."""
    bus, port = wisco_bus(wisco([(0.010, b"DI>0001\r")]))
    port.arrive(port.time.now, WISCO_REPLY)
    port.arrive(port.time.now + 0.005, b"DI>9")  # still going on: it is let finish
    assert bus.exchange(WISCO_READ, protected=False) == 1
    assert bus.counters.unsolicited_bytes == 12


@pytest.mark.parametrize(
    ("reply", "stray", "is_good"),
    [
        ([(0.010, b"#0ARDO\r" + WISCO_REPLY)], b"#0ARDO\r", True),
        ([(0.010, b"DO>8B72\r"), (0.030, WISCO_REPLY)], b"DO>8B72\r", False),
        ([(0.010, b"DI>9EA\x0b\r")], b"", False),
    ],
    ids=["in front of a reply", "in place of it", "a damaged reply"],
)
def test_bytes_that_nobody_asked_for_instead_of_a_reply(
    reply: list[Chunk], stray: bytes, is_good: bool
) -> None:
    """Bytes besides a reply are unsolicited; a damaged one has its length, and only is bad."""
    bus, _ = wisco_bus(wisco([(0.010, WISCO_REPLY)], reply))
    bus.exchange(WISCO_READ, protected=False)
    with nullcontext() if is_good else pytest.raises(BadReplyError):
        assert bus.exchange(WISCO_READ, protected=False) == VALUE
    assert bus.counters.unsolicited_bytes == len(stray)
    assert bus.stray.startswith(stray)


def test_listening_takes_what_nobody_asked_for() -> None:
    """While nothing is to be sent, what comes is counted and does not pile up."""
    bus, port = wisco_bus(wisco())
    port.arrive(port.time.now, b"#0ARDO\r")
    bus.listen()
    assert bus.counters.unsolicited_bytes == 7
    assert bus.stray == b"#0ARDO\r"
    assert port.discard() == b""


def test_what_comes_in_the_late_window_is_late() -> None:
    """Bytes in the late window are late; bytes after it are unsolicited."""
    reply = [(0.020, RTU_REPLY)]
    bus, port = rtu_bus(rtu(reply, [], reply, reply))
    bus.exchange(RTU_READ, protected=True)
    with pytest.raises(NoReplyError):
        bus.exchange(RTU_READ, protected=True)
    port.arrive(port.time.now + 0.005, b"\x07" * 3)
    bus.exchange(RTU_READ, protected=True)
    assert (bus.counters.late_bytes, bus.counters.unsolicited_bytes) == (3, 0)
    port.time.sleep(LATE_WINDOW_S)
    bus.listen()
    port.arrive(port.time.now, b"\x07" * 3)
    bus.exchange(RTU_READ, protected=True)
    assert (bus.counters.late_bytes, bus.counters.unsolicited_bytes) == (3, 3)


@pytest.mark.parametrize("begun", [[], [(0.010, b"DI>")]], ids=["silent", "incomplete"])
def test_late_unprotected_reply_is_waited_for_and_dropped(begun: list[Chunk]) -> None:
    """After a missed Wisco reply nothing is sent until a late one can come no more."""
    bus, port = wisco_bus(wisco([*begun, (0.4, b"DI>FFFF\r")], [(0.010, WISCO_REPLY)]))
    with pytest.raises((NoReplyError, BadReplyError)):
        bus.exchange(WISCO_READ, protected=False)
    timed_out_at = port.sent[0][0] + 16 * CHAR_S + 0.105
    assert bus.quiet_until == pytest.approx(timed_out_at + LATE_WINDOW_S)
    assert bus.exchange(WISCO_READ, protected=False) == VALUE
    assert port.sent[1][0] == pytest.approx(bus.quiet_until + 0.02)  # and the drain
    assert bus.counters.late_bytes == 8
    assert bus.counters.unsolicited_bytes == 0


def test_a_late_unprotected_reply_is_waited_for_only_where_it_could_be_taken() -> None:
    """It comes just before a reply that carries its station, and is not taken for it."""
    other = AsciiRequest(9, ReadDiscreteInputs(0, 16))
    late = [(0.135, b"DI>FFFF\r")]
    heard = [(0.020, b":0902"), (0.030, b"02AB9EAA\r\n")]
    answer = Transcript(
        (WISCO_READ.frame, late), (other.frame, heard), (WISCO_READ.frame, [(0.010, WISCO_REPLY)])
    )
    bus, port = wisco_bus(answer)
    with pytest.raises(NoReplyError):
        bus.exchange(WISCO_READ, protected=False)
    given_up_at = port.time.now
    assert bus.free_at(other.address, protected=True) <= given_up_at
    assert bus.exchange(other, protected=True) == VALUE
    assert port.sent[1][0] == given_up_at
    assert bus.exchange(WISCO_READ, protected=False) == VALUE
    assert port.sent[2][0] >= given_up_at + LATE_WINDOW_S


def test_a_bad_reply_ends_no_earlier_wait_for_a_late_one() -> None:
    """What comes late after it still counts as late, and not as a stranger's."""
    other = AsciiRequest(9, ReadDiscreteInputs(0, 16))
    answer = Transcript(
        (WISCO_READ.frame, [(0.4, b"DI>FFFF\r")]), (other.frame, [(0.020, b":0902DI>\r\n")])
    )
    bus, port = wisco_bus(answer)
    with pytest.raises(NoReplyError):
        bus.exchange(WISCO_READ, protected=False)
    with pytest.raises(BadReplyError):
        bus.exchange(other, protected=True)
    port.time.sleep(LATE_WINDOW_S)
    bus.listen()
    assert (bus.counters.late_bytes, bus.counters.unsolicited_bytes) == (8, 0)


def test_a_new_connection_is_silent_for_frames_of_all_kinds() -> None:
    """What a gateway held back comes first (docs/failures.md F13)."""
    request = AsciiRequest(9, ReadDiscreteInputs(0, 16))
    bus, port = wisco_bus(Transcript((request.frame, [(0.020, b":090202AB9EAA\r\n")])))
    bus.await_silence()
    assert bus.free_at(request.address, protected=True) == bus.quiet_until
    assert bus.exchange(request, protected=True) == VALUE
    assert port.sent[0][0] >= bus.quiet_until


def test_missed_protected_reply_delays_nobody_else() -> None:
    """A late reply that carries station and checksum can be told: other stations are asked."""
    other = RtuRequest(9, ReadDiscreteInputs(0, 16))
    answer = Transcript((RTU_READ.frame, []), (other.frame, []))
    bus, port = rtu_bus(answer)
    with pytest.raises(NoReplyError):
        bus.exchange(RTU_READ, protected=True)
    given_up_at = port.time.now
    with pytest.raises(NoReplyError):
        bus.exchange(other, protected=True)
    assert port.sent[1][0] == given_up_at


@pytest.mark.parametrize("late", [[(0.200, RTU_REPLY)], [(0.05, RTU_REPLY[:4]), (0.2, b"x")]])
def test_a_late_reply_of_a_station_passes_before_it_is_asked_again(late: list[Chunk]) -> None:
    """A late reply of a station has to pass before that station is asked again."""
    bus, port = rtu_bus(rtu(late, [(0.020, RTU_REPLY)], [(0.020, RTU_REPLY)]))
    with pytest.raises((NoReplyError, BadReplyError)):
        bus.exchange(RTU_READ, protected=True)
    free_at = bus.free_at(RTU_READ.address)
    assert free_at >= port.time.now + LATE_WINDOW_S - 0.1  # the drain after an incomplete one
    assert bus.free_at(RTU_READ.address + 1) == 0.0
    bus.exchange(RTU_READ, protected=True)
    assert port.sent[1][0] >= free_at
    assert bus.counters.late_bytes > 0
    assert bus.free_at(RTU_READ.address) == free_at  # nothing is awaited any more
    bus.exchange(RTU_READ, protected=True)
    assert port.sent[2][0] < port.sent[1][0] + 0.1


def test_a_reply_to_another_request_leaves_the_own_one_due() -> None:
    """The station is asked again when that cannot come any more."""
    late_write_reply = bytes.fromhex("01 05 00 03 FF 00 7C 3A")
    bus, port = rtu_bus(rtu([(0.010, late_write_reply), (0.1, RTU_REPLY)], [(0.020, RTU_REPLY)]))
    with pytest.raises(BadReplyError):
        bus.exchange(RTU_READ, protected=True)
    assert bus.free_at(RTU_READ.address) > port.sent[0][0] + 0.1 + len(RTU_REPLY) * CHAR_S
    assert bus.exchange(RTU_READ, protected=True) == VALUE
    assert bus.counters.late_bytes == len(RTU_REPLY)


def test_what_is_too_late_is_not_sent() -> None:
    """The line was not free for it before: another program's bytes held it up."""
    bus, port = rtu_bus(rtu([(0.020, RTU_REPLY)]))
    now = port.time.now
    port.arrive(now, b"\x07" * 20)
    with pytest.raises(ExpiredError):
        bus.exchange(RTU_READ, protected=True, not_after=now + 0.001)
    assert port.sent == []
    assert bus.exchange(RTU_READ, protected=True, not_after=port.time.now) == VALUE


def test_reply_behind_another_ones_reply() -> None:
    """After a foreign Wisco reply our own is awaited until the deadline."""
    foreign, own = (0.010, b"DO>8B72\r"), (0.080, WISCO_REPLY)
    read = ReadOutputsHex(5, DO100)
    answer = Transcript((WISCO_READ.frame, [foreign, own]), (read.frame, [(0.01, b"DO>0001\r")]))
    bus, port = wisco_bus(answer)
    with pytest.raises(BadReplyError):
        bus.exchange(WISCO_READ, protected=False)
    assert bus.exchange(read, protected=False) == 1
    assert port.sent[1][0] > port.sent[0][0] + 0.080


def test_no_late_reply_is_given_to_another_station() -> None:
    """Of 20,000 polls, some answered late, none gets the value of another station."""
    dice = random.Random(8)  # noqa: S311  # a repeatable line, not a secret

    def answer(frame: bytes) -> list[Chunk]:
        late = dice.random() < 0.01
        delay_s = dice.uniform(0.13, 0.13 + LATE_WINDOW_S - 0.02) if late else 0.012
        return [(delay_s, b"DI>%04X\r" % int(frame[1:3], 16))]

    bus, _ = wisco_bus(answer)
    polls = [ReadInputsHex(address) for address in range(1, 32)]
    for n in range(20_000):
        request = polls[n % len(polls)]
        try:
            assert bus.exchange(request, protected=False) == request.address
        except NoReplyError:
            continue
    assert bus.counters.silent > 100
    assert bus.counters.late_bytes == 8 * bus.counters.silent
    assert bus.counters.unsolicited_bytes == 0


def test_port_trouble_passes_through() -> None:
    """PortError is raised unchanged, and no exchange is counted."""

    def hang_up(_: bytes) -> list[Chunk]:
        raise PortError("virtual: gone")

    bus, _ = wisco_bus(hang_up)
    with pytest.raises(PortError, match="gone"):
        bus.exchange(WISCO_READ, protected=False)
    counters = bus.counters
    assert (counters.good, counters.silent, counters.bad, counters.refused) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("request_", "reply"), [(WISCO_READ, WISCO_REPLY), (RTU_READ, RTU_REPLY)], ids=["wisco", "rtu"]
)
def test_values_pass_byte_by_byte(request_: ReadInputsHex | RtuRequest[int], reply: bytes) -> None:
    """A line that delivers one byte at a time is as good as any."""
    drops = [(0.01 + n * CHAR_S, reply[n : n + 1]) for n in range(len(reply))]
    bus, _ = wisco_bus(Transcript((request_.frame, drops)))
    assert bus.exchange(request_, protected=True) == VALUE
    assert bus.counters.good == 1


# --- a new connection -----------------------------------------------------------------------------


def test_what_a_gateway_held_back_is_no_reply() -> None:
    """Old bytes of a gateway at the connection are not taken as the reply (F13)."""
    bus, port = wisco_bus(wisco([(0.020, WISCO_REPLY)]))
    bus.await_silence()
    opened_at = port.time.now
    for late_s in (0.0, 0.1, 0.25, 0.4, 0.6):
        port.arrive(opened_at + late_s, b"DI>0000\r")
    assert bus.exchange(WISCO_READ, protected=False) == VALUE
    assert port.sent[0][0] >= opened_at + 0.6 + LATE_WINDOW_S


def test_a_new_connection_that_never_falls_silent_is_used_all_the_same() -> None:
    """After 2 s and the window."""
    bus, port = rtu_bus(rtu([(0.020, RTU_REPLY)]))
    bus.await_silence()
    opened_at = port.time.now
    for n in range(400):
        port.arrive(opened_at + n * 0.01, b"\x55")
    assert bus.exchange(RTU_READ, protected=True) == VALUE
    assert port.sent[0][0] < opened_at + 4.0


def test_a_new_connection_that_is_silent_waits_for_the_window_alone() -> None:
    """A silent new connection waits once for the late window."""
    bus, port = wisco_bus(wisco([(0.020, WISCO_REPLY)], [(0.020, WISCO_REPLY)]))
    bus.await_silence()
    opened_at = port.time.now
    for _ in range(2):
        assert bus.exchange(WISCO_READ, protected=False) == VALUE
    assert [at - opened_at for at, _ in port.sent] == pytest.approx(
        [LATE_WINDOW_S, LATE_WINDOW_S + 0.020]
    )


def test_the_line_feed_of_cr_lf_is_no_stranger() -> None:
    """It is dropped, and from then on the line waits for it before the next request."""
    bus, port = wisco_bus(wisco(*[[(0.020, WISCO_REPLY), (0.021, b"\n")]] * 4))
    for _ in range(4):
        assert bus.exchange(WISCO_READ, protected=False) == VALUE
    assert bus.counters.unsolicited_bytes == 0
    assert bus.counters.late_bytes == 0
    sent = [at for at, _ in port.sent]
    assert sent[-1] - sent[-2] >= 0.020 + 2 * CHAR_S


def test_another_byte_is_a_stranger_still() -> None:
    """An LF alone is forgiven, and nothing else."""
    bus, _ = wisco_bus(wisco(*[[(0.020, WISCO_REPLY), (0.0201, b"\n?")]] * 3))
    for _ in range(3):
        assert bus.exchange(WISCO_READ, protected=False) == VALUE
    assert bus.counters.unsolicited_bytes


def test_replies_after_the_time_out_are_named() -> None:
    """Who asks again is told why nothing came: docs/protocol.md, reading turnaround."""
    late = [(0.25, WISCO_REPLY)]
    bus, _ = wisco_bus(wisco(late, late))
    with pytest.raises(NoReplyError) as first:
        bus.exchange(WISCO_READ, protected=False)
    with pytest.raises(NoReplyError) as second:
        bus.exchange(WISCO_READ, protected=False)
    assert (first.value.reading, second.value.reading) == (None, "turnaround")
