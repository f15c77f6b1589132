"""One line in virtual time: who answers, when, and what each fault does on the wire."""

import pytest
from support.virtual_conversation import FREE, Piece, VirtualLine

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import FaultKind, SimulatedModule, is_write
from bridge.simulator.conversation import FLOOD_BYTES, PIECE_CHARS
from bridge.simulator.framing import LEAST_SILENCE_S
from bridge.simulator.modbus import crc
from bridge.simulator.wire import Pace

ASK, REPLY = b"#01RDIH\r", b"DI>0000\r"
RTU_ASK, RTU_REPLY = bytes.fromhex("0101000000083DCC"), bytes.fromhex("010101005188")
WRITE, OK = b"#01WDO3,1\r", b"DO>OK\r"


def wisco_line(pace: Pace = FREE, seed: int = 1) -> VirtualLine:
    """A DIO100 at station 1 and a DO100 at 2, switch 8 ON."""
    modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)]
    return VirtualLine(LineProtocol.WISCO, modules, pace, seed)


def rtu_line(pace: Pace = FREE) -> VirtualLine:
    """A DIO100 at station 1, switch 8 OFF."""
    return VirtualLine(LineProtocol.MODBUS_RTU, [SimulatedModule(DIO100, 1)], pace)


# --- who answers ---


@pytest.mark.parametrize("protocol", [LineProtocol.WISCO, LineProtocol.MODBUS_ASCII])
def test_switch_8_on_answers_both_protocols(protocol: LineProtocol) -> None:
    """Wisco and Modbus ASCII frames are answered on the same line, whatever it is called."""
    line = VirtualLine(protocol, [SimulatedModule(DIO100, 1)])
    assert line.ask(ASK) == REPLY
    assert line.ask(b":010200000010ED\r\n") == b":0102020000FB\r\n"


def test_switch_8_off_answers_rtu_alone() -> None:
    """RTU is answered, the two others are noise there."""
    line = rtu_line()
    assert line.ask(RTU_ASK) == RTU_REPLY
    assert line.ask(ASK) == b""
    assert line.ask(b":010200000010ED\r\n") == b""
    assert line.ask(RTU_ASK) == RTU_REPLY


def test_wisco_only_module_ignores_ascii() -> None:
    """A module made Wisco-only answers Wisco frames and is silent to Modbus ASCII."""
    line = VirtualLine(LineProtocol.WISCO, [SimulatedModule(DIO100, 1, wisco_only=True)])
    assert line.ask(b":010200000010ED\r\n") == b""
    assert line.ask(ASK) == REPLY


def test_only_the_called_station_answers() -> None:
    """One reply, of the one that is called; no module answers for a station that is not there."""
    line = wisco_line()
    assert line.ask(b"#02RDOH\r") == b"DO>0000\r"
    assert line.ask(b"#03RDOH\r") == b""


def test_away_module_hears_and_says_nothing() -> None:
    """Away: not answered, not carried out; back: as before, outputs as they were."""
    module = SimulatedModule(DIO100, 1)
    line = VirtualLine(LineProtocol.WISCO, [module])
    line.ask(b"#01WDO8,1\r")
    module.away = True
    assert line.ask(WRITE) == b""
    module.away = False
    assert line.ask(b"#01RDOH\r") == b"DO>80\r"


def test_unknown_function_over_rtu() -> None:
    """A function whose length is not known is refused after a silence: exception 01."""
    ask = b"\x01\x07" + crc(b"\x01\x07")
    line = rtu_line()
    line.send(ask)
    (piece,) = line.run()
    assert piece == Piece(LEAST_SILENCE_S, b"\x01\x87\x01" + crc(b"\x01\x87\x01"))


def test_silence_after_a_part_drops_it() -> None:
    """Half a request and silence: the next request is heard as if nothing had been."""
    line = rtu_line()
    assert line.ask(RTU_ASK[:5]) == b""
    assert line.ask(RTU_ASK) == RTU_REPLY


def test_gap_in_a_gust_is_not_silence() -> None:
    """Bytes that come in two gusts within the tolerated gap are one request."""
    line = rtu_line()
    line.send(RTU_ASK[:5])
    assert line.run(until=LEAST_SILENCE_S / 2) == []
    line.now = LEAST_SILENCE_S / 2
    line.send(RTU_ASK[5:])
    assert b"".join(piece.data or b"" for piece in line.run()) == RTU_REPLY


# --- when ---


@pytest.mark.parametrize(("baud", "floor_s"), [(9600, 0.01867), (57600, 0.00478)])
def test_wisco_reply_takes_its_time(baud: int, floor_s: float) -> None:
    """Request and reply pass at 10 bit times a character, as docs/protocol.md works it out."""
    pace = Pace.of(LineProtocol.WISCO, baud, 0.002, paced=True)
    line = wisco_line(pace)
    line.send(ASK)
    (piece,) = line.run()
    assert piece.at == pytest.approx(floor_s, abs=0.00001)
    assert piece.data == REPLY


@pytest.mark.parametrize(
    ("baud", "silence_s"), [(9600, 3.5 * 10 / 9600), (19200, 3.5 * 10 / 19200), (57600, 0.00175)]
)
def test_rtu_reply_takes_its_time(baud: int, silence_s: float) -> None:
    """Over RTU the module knows the request's end after a silence, fixed above 19200 baud."""
    line = rtu_line(Pace.of(LineProtocol.MODBUS_RTU, baud, 0.002, paced=True))
    line.send(RTU_ASK)
    (piece,) = line.run()
    assert piece.at == pytest.approx(14 * 10 / baud + silence_s + 0.002)
    assert piece.data == RTU_REPLY


def test_unpaced_line_waits_for_the_turnaround_alone() -> None:
    """Unpaced, bytes take no time; what the module takes stays."""
    line = wisco_line(Pace.of(LineProtocol.WISCO, 4800, 0.5, paced=False))
    line.send(ASK)
    assert line.run() == [Piece(0.5, REPLY)]


def test_request_is_carried_out_when_it_has_passed() -> None:
    """An output switches when the last character is through, not when the first one is sent."""
    module = SimulatedModule(DIO100, 1)
    pace = Pace.of(LineProtocol.WISCO, 9600, 0.002, paced=True)
    line = VirtualLine(LineProtocol.WISCO, [module], pace)
    line.send(WRITE)
    assert line.run(until=9.9 * 10 / 9600) == []
    assert module.outputs == 0
    line.run(until=10.1 * 10 / 9600)
    assert module.outputs == 0b100


def test_requests_queue_up_on_the_wire() -> None:
    """A request sent while another passes passes after it."""
    line = wisco_line(Pace(char_s=1.0, silence_s=0.0, turnaround_s=0.0))
    line.send(ASK)
    line.send(b"#02RDOH\r")
    assert line.run() == [Piece(16.0, REPLY), Piece(24.0, b"DO>0000\r")]


def test_long_reply_comes_in_pieces() -> None:
    """A long reply reaches the master bit by bit, not all at its end."""
    line = wisco_line(Pace(char_s=1.0, silence_s=0.0, turnaround_s=0.0))
    line.send(b"#01REE000000020\r")
    pieces = line.run()
    assert [piece.at for piece in pieces] == [32.0, 48.0, 64.0, 80.0, 86.0]
    assert [len(piece.data or b"") for piece in pieces] == [PIECE_CHARS] * 4 + [6]


# --- faults ---


def test_healthy_line_has_no_faults() -> None:
    """Without a fault every request is answered."""
    line = wisco_line()
    assert [line.ask(ASK) for _ in range(50)] == [REPLY] * 50
    assert not line.faults.struck


STATE = b"#01RDOH\r"


@pytest.mark.parametrize(
    ("kind", "bit", "exchanges"),
    [
        pytest.param("deaf", None, [(WRITE, b""), (STATE, b"DO>00\r")], id="not carried out"),
        pytest.param("silent", None, [(WRITE, b""), (STATE, b"DO>04\r")], id="carried out"),
        pytest.param("refuse", None, [(WRITE, b"ERR=3\r"), (STATE, b"DO>00\r")], id="refused"),
        pytest.param(
            "refuse",
            None,
            [(b":01050003FF00F8\r\n", b":01850476\r\n"), (STATE, b"DO>00\r")],
            id="refused in ASCII",
        ),
        pytest.param("flip", 0, [(ASK, b"EI>0000\r"), (ASK, REPLY)], id="first bit flipped"),
        pytest.param("flip", 25, [(ASK, b"DI>2000\r"), (ASK, REPLY)], id="a value flipped"),
        pytest.param("flip-request", 49, [(b"#01WDO1,1\r", OK), (STATE, b"DO>04\r")], id="heard 3"),
        pytest.param("duplicate", None, [(ASK, REPLY * 2)], id="twice"),
        pytest.param(
            "merge", None, [(ASK, b""), (b"#02RDOH\r", REPLY + b"DO>0000\r")], id="with the next"
        ),
    ],
)
def test_a_fault_of_one_request(
    kind: str, bit: int | None, exchanges: list[tuple[bytes, bytes]]
) -> None:
    """What the master reads of each fault, and what the module did."""
    line = wisco_line()
    line.faults.set(kind, address=1, bit=bit, times=1)
    for ask, reply in exchanges:
        assert line.ask(ask) == reply


def test_refusing_module_ignores_damaged_frames() -> None:
    """A refusing module does not answer a damaged frame."""
    line = rtu_line()
    line.faults.set("refuse")
    assert line.ask(RTU_ASK[:-1] + b"\x00") == b""
    assert line.ask(RTU_ASK) == b"\x01\x81\x04" + crc(b"\x01\x81\x04")


def test_late() -> None:
    """Late: the same reply, later; another station can answer before it."""
    line = wisco_line()
    line.faults.set("late", address=1, delay_s=0.4, times=1)
    line.send(ASK)
    assert line.run(until=0.3) == []
    line.now = 0.3
    line.send(b"#02RDOH\r")
    assert line.run() == [Piece(0.3, b"DO>0000\r"), Piece(0.4, REPLY)]


def test_flip_of_any_bit() -> None:
    """Without a bit named, one bit of the reply is turned over, not always the same."""
    line = wisco_line()
    line.faults.set("flip")
    replies = {line.ask(ASK) for _ in range(50)}
    assert len(replies) > 10
    for reply in replies:
        differing = int.from_bytes(reply, "big") ^ int.from_bytes(REPLY, "big")
        assert differing.bit_count() == 1


def test_flip_request_in_the_address() -> None:
    """A flipped address: another module carries it out."""
    line = wisco_line()
    line.faults.set("flip-request", address=1, bit=2 * 8 + 1, times=1)
    assert line.ask(b"#01RDOH\r") == b""  # 01 became 03
    line.faults.set("flip-request", address=2, bit=2 * 8 + 1, times=1)
    assert line.ask(b"#02RDI\r") == b""  # 02 became 00


def test_flip_request_never_gets_past_a_crc() -> None:
    """Over RTU every single flipped bit of a request is noticed: no answer, no switching."""
    module = SimulatedModule(DIO100, 1)
    line = VirtualLine(LineProtocol.MODBUS_RTU, [module])
    frame = bytes.fromhex("010F0000000801727EB0")
    for bit in range(8 * len(frame)):
        line.faults.set("flip-request", bit=bit, times=1)
        assert line.ask(frame) == b""
    assert line.faults.struck[FaultKind.FLIP_REQUEST] == 8 * len(frame)
    assert not module.switchings


def test_truncate() -> None:
    """Truncate: the beginning of the reply, at least a byte, never all."""
    line = wisco_line()
    line.faults.set("truncate")
    replies = {line.ask(ASK) for _ in range(100)}
    assert replies == {REPLY[:size] for size in range(1, len(REPLY))}


def test_noise() -> None:
    """Noise: random bytes before and after the reply."""
    line = wisco_line()
    line.faults.set("noise")
    for _ in range(20):
        before, reply, after = line.ask(ASK).partition(REPLY)
        assert reply
        assert 1 <= len(before) <= 4
        assert 1 <= len(after) <= 4


def test_flood() -> None:
    """Flood: a great many bytes in place of the reply."""
    line = wisco_line()
    line.faults.set("flood", times=1)
    flood = line.ask(ASK)
    assert len(flood) == FLOOD_BYTES
    assert len(set(flood)) > 200


def test_echo() -> None:
    """With ECHO the request comes back first, also without a module, and byte by byte."""
    line = wisco_line()
    line.faults.set("echo")
    assert line.ask(ASK) == ASK + REPLY
    assert line.ask(b"#09RDI\r") == b"#09RDI\r"
    assert line.ask(b"xyz") == b"xyz"


def test_echo_is_as_slow_as_the_wire() -> None:
    """The echo is through when the request is, before the reply begins."""
    line = wisco_line(Pace(char_s=1.0, silence_s=0.0, turnaround_s=1.0))
    line.faults.set("echo")
    line.send(ASK)
    assert line.run() == [Piece(8.0, ASK), Piece(17.0, REPLY)]


def test_hang_up() -> None:
    """Hang-up: the port goes away on a request, which is not carried out."""
    line = wisco_line()
    line.faults.set("hang-up", times=1)
    line.send(WRITE)
    assert line.run() == [Piece(0.0, None)]
    assert line.ask(b"#01RDOH\r") == b"DO>00\r"


def test_injected_bytes() -> None:
    """Bytes that were not requested pass like any other."""
    line = wisco_line(Pace(char_s=1.0, silence_s=0.0, turnaround_s=0.0))
    line.conversation.inject(b"#07RDI\r", 5.0)
    assert line.run() == [Piece(12.0, b"#07RDI\r")]


def test_reset_forgets_what_is_under_way() -> None:
    """A port that went away takes with it what was on the wire."""
    line = wisco_line(Pace(char_s=1.0, silence_s=0.0, turnaround_s=0.0))
    line.faults.set("merge", times=1)
    line.ask(ASK)
    line.send(ASK + b"#01R")
    line.conversation.reset()
    assert line.run() == []
    line.send(b"DI\r")
    assert line.run() == []
    assert line.ask(ASK) == REPLY


# --- how often, and where ---


def test_fault_of_one_station() -> None:
    """A fault of one station leaves the others alone."""
    line = wisco_line()
    line.faults.set("silent", address=2)
    assert line.ask(ASK) == REPLY
    assert line.ask(b"#02RDOH\r") == b""
    line.faults.clear("silent", address=2)
    assert line.ask(b"#02RDOH\r") == b"DO>0000\r"


def test_fault_strikes_so_many_times() -> None:
    """`times=3` strikes three requests to modules that are there; others do not use it up."""
    line = wisco_line()
    line.faults.set("silent", times=3)
    assert line.ask(b"#09RDI\r") == b""
    assert [bool(line.ask(ASK)) for _ in range(5)] == [False, False, False, True, True]
    assert line.faults.struck == {FaultKind.SILENT: 3}


def test_probability() -> None:
    """About as often as asked, and with one seed always alike."""
    runs = []
    for _ in range(2):
        line = wisco_line(seed=7)
        line.faults.set("silent", probability=0.25)
        runs.append([line.ask(ASK) for _ in range(1000)])
    assert runs[0] == runs[1]
    assert 200 < runs[0].count(b"") < 300


def test_only_writes() -> None:
    """A fault for writes lets reads go by, in each protocol."""
    line = wisco_line()
    line.faults.set("silent", only=is_write)
    assert line.ask(ASK) == REPLY
    assert line.ask(WRITE) == b""
    assert line.ask(b":01050003FF00F8\r\n") == b""
    line.faults.set("echo")
    line.faults.clear()  # of whatever kind
    assert line.ask(WRITE) == OK


@pytest.mark.parametrize(
    ("frame", "write"),
    [
        (b"#01WDOX01,01\r", True),
        (b"#01WEE00000010000\r", True),
        (b"#01RDO\r", False),
        (b":010F00000008017275\r\n", True),
        (b":010300000009F3\r\n", False),
        (bytes.fromhex("01060001001919C0"), True),
        (RTU_ASK, False),
    ],
)
def test_is_write(frame: bytes, write: bool) -> None:
    """`is_write` returns True for requests that change something."""
    assert is_write(frame) is write


def test_faults_that_cannot_be() -> None:
    """Slips of a test are told: kinds, probabilities, and an echo at a station."""
    faults = wisco_line().faults
    with pytest.raises(ValueError, match="'sulky' is not a valid FaultKind"):
        faults.set("sulky")
    with pytest.raises(ValueError, match="from 0 to 1, not 5"):
        faults.set("silent", probability=5)
    with pytest.raises(ValueError, match="for the whole line"):
        faults.set("echo", address=1)
