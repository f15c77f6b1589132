"""Commands on the wire, for each protocol, way of writing and model."""

from dataclasses import dataclass

import pytest
from support.bus_worker import BusWorker, Script
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import OutputConfig
from bridge.model import (
    DIO100,
    DO100,
    LineProtocol,
    ModuleType,
    Reason,
    Status,
    ValuesChanged,
    Word,
    Writes,
)
from bridge.simulator.faults import is_write

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 102.0  # when the command comes: long after the module is online
END = T + 3.0


@dataclass(frozen=True)
class Way:
    """How a module is spoken to."""

    protocol: LineProtocol
    writes: Writes = Writes.AUTO
    wisco_only: bool = False
    model: ModuleType = DIO100

    def __str__(self) -> str:
        only = "-only" if self.wisco_only else ""
        return f"{self.protocol}{only}-{self.writes}-{self.model.name}"

    @property
    def masked(self) -> bool:
        """Whether writes go as WDOX."""
        wisco = self.protocol is LineProtocol.WISCO
        return wisco and (self.writes is Writes.WISCO or self.wisco_only)

    def worker(self, *outputs: OutputConfig, pulse: int = 0, hold_s: float = 1.0) -> VirtualWorker:
        """A worker whose module `s1` has these pulse outputs."""
        station_config = make_station(model=self.model, outputs=outputs or None)
        config = make_line(station_config, protocol=self.protocol, writes=self.writes)
        worker = VirtualWorker(config, wisco_only=self.wisco_only)
        for output in range(1, self.model.outputs + 1):
            if pulse >> (output - 1) & 1:
                worker.line.modules[1].set_mode(output, pulse=True, hold_s=hold_s)
        return worker


WISCO = Way(LineProtocol.WISCO, Writes.WISCO)
WISCO_ONLY = Way(LineProtocol.WISCO, wisco_only=True)
RTU = Way(LineProtocol.MODBUS_RTU)
WAYS = [
    WISCO,
    WISCO_ONLY,
    Way(LineProtocol.WISCO),
    Way(LineProtocol.WISCO, Writes.MODBUS),
    RTU,
    Way(LineProtocol.MODBUS_ASCII),
    Way(LineProtocol.WISCO, Writes.WISCO, model=DO100),
    Way(LineProtocol.WISCO, model=DO100),
    Way(LineProtocol.MODBUS_RTU, model=DO100),
    Way(LineProtocol.MODBUS_ASCII, model=DO100),
]
MODBUS_WAYS = [way for way in WAYS if not way.masked]
every_way = pytest.mark.parametrize("way", WAYS, ids=str)
every_modbus_way = pytest.mark.parametrize("way", MODBUS_WAYS, ids=str)
LATCHES = tuple(OutputConfig(n, mode="latch") for n in range(1, 9))


def functions(worker: VirtualWorker) -> list[str]:
    """The write frames, by their names."""
    names = {5: "FC05", 15: "FC15"}
    found = []
    for frame in worker.writes():
        if frame.startswith(b"#"):
            found.append(frame[3:7].decode())
        else:
            code = int(frame[3:5], 16) if frame.startswith(b":") else frame[1]
            found.append(names[code])
    return found


def switch_at_write(worker: VirtualWorker, output: int) -> None:
    """Another hand switches an output ON right after the first write, which is lost."""

    def fault(frame: bytes) -> Fault | None:
        if not is_write(frame) or len(worker.writes()) > 0:
            return None
        worker.line.at(worker.line.now, lambda: worker.line.modules[1].set_output(output, True))
        return Fault.LOSE_REQUEST

    worker.line.fault = fault


def judged(worker: VirtualWorker) -> tuple[Status, Reason | None]:
    """The one verdict, in short."""
    verdict = worker.verdict()
    return verdict.status, verdict.reason


# --- what is done ---------------------------------------------------------------------------------


@every_way
@pytest.mark.parametrize("start", [False, True])
@pytest.mark.parametrize("word", ["ON", "OFF", Word.TOGGLE])
def test_a_single_output_is_switched_by_one_frame(way: Way, word: str, start: bool) -> None:
    """One write frame, no other output moves, and a new state is told before the verdict."""
    worker = way.worker()
    output = way.model.outputs
    bit = 1 << (output - 1)
    module = worker.line.modules[1]
    module.set_output(output, start)
    module.set_output(2, True)
    worker.command_at(
        T, bit, bit if word == "ON" else 0, word=Word.TOGGLE if word == "TOGGLE" else None
    )
    worker.run(END)
    wanted = {"ON": True, "OFF": False}.get(word, not start)
    assert module.outputs == (bit if wanted else 0) | 2
    assert functions(worker) == ["WDOX" if way.masked else "FC05"]
    assert judged(worker) == (Status.DONE, None)
    values = [ValuesChanged("s1", 0, module.outputs)] if wanted != start else []
    assert worker.reported(T) == [*values, worker.verdict()]
    assert worker.verdict().ms < 300


@every_way
def test_several_outputs_are_switched_by_one_frame(way: Way) -> None:
    """With gaps: those are as they were (docs/topics.md, What the bridge listens to)."""
    worker = way.worker()
    module = worker.line.modules[1]
    module.set_output(3, True)
    module.set_output(8, True)
    worker.command_at(T, 0b0101_0010, 0b0001_0010)
    worker.run(END)
    assert module.outputs == 0b1001_0110
    assert functions(worker) == ["WDOX" if way.masked else "FC15"]
    assert judged(worker) == (Status.DONE, None)


@every_modbus_way
def test_the_gaps_of_a_range_are_read_just_before_they_are_written(way: Way) -> None:
    """Read and write back to back: an output switched by hand in between polls is not lost."""
    worker = way.worker()
    module = worker.line.modules[1]
    worker.line.at(T, lambda: module.set_output(3, True))
    worker.command_at(T, 0b1001, 0b1001)
    worker.run(END)
    assert module.outputs == 0b1101
    frames = [frame for at, frame in worker.line.wire if at >= T - 0.08]
    before = frames[[is_write(frame) for frame in frames].index(True) - 1]
    assert not before.startswith(b"#")


@every_modbus_way
def test_a_running_pulse_in_a_gap_is_not_touched(way: Way) -> None:
    """`refused` / `busy`, nothing written (docs/failures.md A12)."""
    worker = way.worker(pulse=0b100, hold_s=20.0)
    module = worker.line.modules[1]
    worker.line.at(T - 1, lambda: module.set_output(3, True))
    worker.command_at(T, 0b1001, 0b1001)
    worker.run(END)
    assert judged(worker) == (Status.REFUSED, Reason.BUSY)
    assert worker.writes() == []


@every_modbus_way
def test_a_pulse_in_a_gap_that_is_over_is_no_obstacle(way: Way) -> None:
    """It is OFF, and stays OFF."""
    worker = way.worker(pulse=0b100)
    worker.command_at(T, 0b1001, 0b1001)
    worker.run(END)
    assert judged(worker) == (Status.DONE, None)
    assert worker.line.modules[1].outputs == 0b1001


def test_a_masked_write_passes_by_a_running_pulse() -> None:
    """WDOX touches what its mask names and nothing else: the neighbour's hold time is its own."""
    worker = WISCO.worker(pulse=0b100, hold_s=2.0)
    module = worker.line.modules[1]
    worker.line.at(T - 1, lambda: module.set_output(3, True))
    worker.command_at(T, 0b1001, 0b1001)
    worker.run(END)
    assert judged(worker)[0] is Status.DONE
    ((over_at, _),) = [(s.at, s) for s in module.switchings if s.output == 3 and not s.value]
    assert over_at == pytest.approx(T + 1)


@every_way
def test_press_starts_a_pulse_once(way: Way) -> None:
    """One transmission; the verdict tells whether the read after it still saw it ON."""
    for hold_s, seen_on in ((2.0, True), (0.1, False)):
        outputs = (OutputConfig(2, mode="pulse"),)
        worker = way.worker(*outputs, pulse=0b10, hold_s=hold_s)
        if not seen_on:  # a slow turn of the line: the pulse is over before it is read
            worker.line.baud = 1200
        worker.command_at(T, 0b10, 0b10, word=Word.PRESS)
        worker.run(END)
        assert judged(worker) == (Status.DONE, None)
        assert worker.verdict().seen_on is seen_on
        assert worker.line.modules[1].ordered == {(2, True): 1}


# --- what is lost ---------------------------------------------------------------------------------

ONE_FAULT = [Fault.LOSE_REQUEST, Fault.LOSE_REPLY, Fault.GARBLE_REPLY]


@every_way
@pytest.mark.parametrize("fault", ONE_FAULT, ids=lambda fault: fault.name)
def test_a_pulse_is_sent_once_whatever_is_lost(way: Way, fault: Fault) -> None:
    """Without an acknowledgement nobody can say: `unknown`, and no second ON.

    See docs/failures.md A5.
    """
    worker = way.worker(OutputConfig(2, mode="pulse"), pulse=0b10)
    worker.fault_on_writes(fault)
    worker.command_at(T, 0b10, 0b10, word=Word.PRESS)
    worker.run(END)
    assert judged(worker) == (Status.UNKNOWN, Reason.NO_REPLY)
    assert len(worker.writes()) == 1


@pytest.mark.parametrize("fault", ONE_FAULT, ids=lambda fault: fault.name)
@pytest.mark.parametrize("way", [WISCO, WISCO_ONLY], ids=str)
def test_an_output_whose_mode_is_not_known_counts_as_a_pulse(way: Way, fault: Fault) -> None:
    """Where modes cannot be read, no write is repeated, declared latch or not (promise 1)."""
    worker = way.worker(*LATCHES)
    worker.fault_on_writes(fault)
    worker.command_at(T, 1, 1)
    worker.run(END)
    assert judged(worker) == (Status.UNKNOWN, Reason.NO_REPLY)
    assert len(worker.writes()) == 1


@every_modbus_way
@pytest.mark.parametrize("fault", [Fault.LOSE_REPLY, Fault.GARBLE_REPLY], ids=lambda f: f.name)
def test_a_latch_whose_acknowledgement_is_lost_is_judged_by_the_read(
    way: Way, fault: Fault
) -> None:
    """The module reports what was asked: done, without another write."""
    worker = way.worker()
    worker.fault_on_writes(fault)
    worker.command_at(T, 1, 1)
    worker.run(END)
    assert judged(worker) == (Status.DONE, None)
    assert len(worker.writes()) == 1


@every_modbus_way
@pytest.mark.parametrize(("lost", "sent"), [(1, 2), (2, 2), (9, 2)])
def test_a_latch_write_is_repeated_once_and_no_more(way: Way, lost: int, sent: int) -> None:
    """Lost once: done at the second. Lost for ever: `failed` / `not_confirmed` after two."""
    worker = way.worker()
    worker.fault_on_writes(*[Fault.LOSE_REQUEST] * lost)
    worker.command_at(T, 0b101, 0b101)
    worker.run(END)
    assert len(worker.writes()) == sent
    expected = (Status.DONE, None) if lost == 1 else (Status.FAILED, Reason.NOT_CONFIRMED)
    assert judged(worker) == expected


def test_a_repeated_range_carries_the_gaps_as_read_in_between() -> None:
    """Not as they were before the first write."""
    worker = RTU.worker()
    module = worker.line.modules[1]
    switch_at_write(worker, 2)
    worker.command_at(T, 0b101, 0b101)
    worker.run(END)
    assert module.outputs == 0b111


def test_a_range_is_not_repeated_over_a_pulse_that_began_in_between() -> None:
    """The repeat would fire it again (docs/failures.md A12)."""
    worker = RTU.worker(pulse=0b10, hold_s=5.0)
    switch_at_write(worker, 2)
    worker.command_at(T, 0b101, 0b101)
    worker.run(END)
    assert judged(worker) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert worker.verdict().detail == "an output between them holds a running pulse"
    assert len(worker.writes()) == 1


@every_modbus_way
def test_a_latch_is_not_repeated_when_a_newer_command_waits(way: Way) -> None:
    """The newer is carried out instead (promise 1)."""
    worker = way.worker()
    worker.fault_on_writes(Fault.LOSE_REQUEST)
    worker.command_at(T, 1, 1, command_id="old")
    worker.command_at(T + 0.05, 1, 0, command_id="new")
    worker.run(END)
    assert [(v.id, v.status, v.reason) for v in worker.verdicts()] == [
        ("old", Status.FAILED, Reason.NOT_CONFIRMED),
        ("new", Status.DONE, None),
    ]
    assert len(worker.writes()) == 2
    assert worker.line.modules[1].ordered == {(1, False): 1}


def test_a_latch_is_not_repeated_after_its_deadline() -> None:
    """Nothing is sent after that instant, no second try either (promise 2)."""
    worker = RTU.worker()
    worker.fault_on_writes(Fault.LOSE_REQUEST)
    worker.command_at(T, 1, 1, deadline_s=0.1)
    worker.run(END)
    assert judged(worker) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert len(worker.writes()) == 1


@every_way
@pytest.mark.parametrize("first", [None, *ONE_FAULT], ids=str)
def test_a_module_that_falls_silent_at_a_write_leaves_it_unknown(
    way: Way, first: Fault | None
) -> None:
    """Sent once, not repeated, unreadable afterwards; and the line is held for less than 2 s."""
    worker = way.worker()
    worker.fault_from_first_write(first, Fault.LOSE_REPLY)
    worker.command_at(T, 1, 1)
    worker.run(END)
    assert judged(worker) == (Status.UNKNOWN, Reason.NO_REPLY)
    assert len(worker.writes()) == 1
    assert worker.verdict().ms < 2000


@every_way
def test_a_toggle_that_cannot_read_sends_nothing(way: Way) -> None:
    """`failed` / `no_reply`: an absolute value takes a fresh read."""
    worker = way.worker()

    def fault(_: bytes) -> Fault | None:
        return Fault.LOSE_REPLY if worker.line.now >= T - 0.1 else None

    worker.line.fault = fault
    worker.command_at(T, 1, word=Word.TOGGLE)
    worker.run(END)
    assert judged(worker) == (Status.FAILED, Reason.NO_REPLY)
    assert worker.writes() == []


@every_way
@pytest.mark.parametrize("fault", [Fault.LOSE_REPLY, Fault.FLIP_REPLY], ids=lambda f: f.name)
def test_a_spoilt_reply_to_the_read_back_is_read_again(way: Way, fault: Fault) -> None:
    """Lost, it costs no verdict; with a flipped bit, it is not believed (promise 5)."""
    worker = way.worker()
    left = [None, fault]

    def spoil(frame: bytes) -> Fault | None:
        return left.pop(0) if left and (len(left) < 2 or is_write(frame)) else None

    worker.line.fault = spoil
    worker.command_at(T, 1, 1)
    worker.run(END)
    assert judged(worker) == (Status.DONE, None)
    assert left == []
    assert [e for e in worker.reported(T) if isinstance(e, ValuesChanged)] == [
        ValuesChanged("s1", 0, 1)
    ]


# --- what is refused and what fails ---------------------------------------------------------------


@every_way
def test_a_toggle_of_a_pulse_is_refused(way: Way) -> None:
    """`bad_payload`, whether it was read or declared."""
    worker = way.worker(OutputConfig(2, mode="pulse"), pulse=0b10)
    worker.command_at(T, 0b10, word=Word.TOGGLE)
    worker.run(END)
    assert judged(worker) == (Status.REFUSED, Reason.BAD_PAYLOAD)
    assert worker.writes() == []


def test_a_module_that_refuses_is_asked_once() -> None:
    """`failed` / `module_refused` with its code; it is read afterwards all the same."""
    for way, code in ((WISCO, 3), (RTU, 4)):
        worker = way.worker()
        worker.fault_on_writes(Fault.REFUSE)
        worker.command_at(T, 1, 1)
        worker.run(END)
        verdict = worker.verdict()
        assert (verdict.status, verdict.reason) == (Status.FAILED, Reason.MODULE_REFUSED)
        assert verdict.code == code
        assert len(worker.writes()) == 1


def refusing_modes(worker: VirtualWorker, until: float) -> None:
    """The module refuses to tell its modes (code 4, device failure) until then."""
    line = worker.line
    line.fault = lambda frame: Fault.REFUSE if frame[1:2] == b"\x03" and line.now < until else None


@pytest.mark.parametrize(
    ("pulse", "until", "judged_as", "writes"),
    [
        (0b01, T, (Status.DONE, None), 1),
        (0b00, T, (Status.REFUSED, Reason.BAD_PAYLOAD), 0),
        (0b01, END, (Status.FAILED, Reason.MODULE_REFUSED), 0),
    ],
)
def test_a_press_asks_a_module_again_that_did_not_tell_its_modes_when_it_was_met(
    pulse: int, until: float, judged_as: tuple[Status, Reason | None], writes: int
) -> None:
    """It may have been busy then: a pulse is pressed, a latch never, and in doubt nothing."""
    worker = RTU.worker(pulse=pulse)
    refusing_modes(worker, until)
    worker.command_at(T, 1, 1, word=Word.PRESS)
    worker.run(END)
    assert judged(worker) == judged_as
    assert len(worker.writes()) == writes


@every_way
def test_a_module_that_acknowledges_and_does_nothing_is_found_out(way: Way) -> None:
    """`failed` / `not_confirmed`: every write is read back (promise 6)."""
    worker = way.worker()
    worker.fault_on_writes(Fault.IGNORE, Fault.IGNORE)
    worker.command_at(T, 1, 0 if way.masked else 1)
    if way.masked:  # an ON that cannot be seen may be a pulse that is over: OFF is demanded
        worker.line.modules[1].set_output(1, True)
    worker.run(END)
    assert judged(worker) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert len(worker.writes()) == (1 if way.masked else 2)


def test_of_pulses_and_latches_in_one_write_the_latches_are_checked() -> None:
    """A pulse may be over; what was to be ON and is a latch, or OFF, has to be so."""
    worker = RTU.worker(pulse=0b01)
    worker.fault_on_writes(Fault.IGNORE)
    worker.command_at(T, 0b11, 0b11)
    worker.run(END)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert verdict.seen_on is False
    assert len(worker.writes()) == 1


@every_way
def test_nothing_is_sent_after_the_deadline(way: Way) -> None:
    """Not even when it passes while the command is prepared (promise 2)."""
    for word, mask in ((None, 1), (Word.TOGGLE, 1)):
        worker = way.worker()
        worker.command_at(T, mask, 0, word=word, deadline_s=0.0)
        worker.run(END)
        assert judged(worker) == (Status.REFUSED, Reason.EXPIRED)
        assert worker.writes() == []
    worker = way.worker()
    left = [Fault.LOSE_REPLY]
    worker.line.fault = lambda _: left.pop() if left and worker.line.now >= T else None
    worker.command_at(T, 1, word=Word.TOGGLE, deadline_s=0.09)
    worker.run(END)
    assert judged(worker) == (Status.REFUSED, Reason.EXPIRED)
    assert worker.writes() == []


def test_bytes_of_somebody_else_count_before_the_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bus waits until they are over, and then it is too late: nothing is sent (promise 2)."""
    worker = BusWorker(make_line(make_station(), protocol=LineProtocol.MODBUS_RTU))

    def script() -> Script:
        command = worker.command(1, 1)

        def chatter(_station: int, **_: bool) -> float:
            """Just before the write, and just before it is too late."""
            worker.line.advance(command.deadline - 0.001)
            worker.bus_line.foreign = b"#01RDI"
            return 0.0

        monkeypatch.setattr(worker.bus_line.bus, "free_at", chatter)
        yield command
        yield 1.0

    worker.follow(script())
    assert judged(worker) == (Status.REFUSED, Reason.EXPIRED)
    assert worker.writes() == []
    assert not worker.worker._switcher.sent


def test_the_late_window_counts_before_the_deadline() -> None:
    """A write that the bus would hold back past its deadline is not begun (promise 2)."""
    worker = WISCO.worker()
    # One poll is lost at T: for 0.3 s after its time-out nothing may be sent.
    worker.line.fault = lambda _: Fault.LOSE_REPLY if T <= worker.line.now < T + 0.02 else None
    worker.command_at(T + 0.1, 1, 1, deadline_s=0.15)
    worker.run(END)
    assert judged(worker) == (Status.REFUSED, Reason.EXPIRED)
    assert worker.writes() == []


@every_way
def test_a_port_that_goes_before_anything_was_sent_is_a_failure(way: Way) -> None:
    """`failed` / `port_down` for a TOGGLE that was still reading."""
    worker = way.worker()
    left = [Fault.PORT_GONE]
    worker.line.fault = lambda _: left.pop() if left and worker.line.now >= T else None
    worker.command_at(T, 1, word=Word.TOGGLE)
    worker.run(END)
    assert judged(worker) == (Status.FAILED, Reason.PORT_DOWN)
    assert worker.writes() == []


@every_way
@pytest.mark.parametrize("fault", [Fault.PORT_GONE, Fault.PORT_GONE_AFTER], ids=lambda f: f.name)
def test_a_port_that_goes_at_a_write_leaves_it_unknown(way: Way, fault: Fault) -> None:
    """It is not known how much of the frame got out; and it is not sent again (promise 4)."""
    worker = way.worker()
    worker.fault_on_writes(fault)
    worker.command_at(T, 1, 1)
    worker.run(END)
    assert judged(worker) == (Status.UNKNOWN, Reason.PORT_DOWN)
    assert len(worker.writes()) == (fault is Fault.PORT_GONE_AFTER)
    assert worker.online_at()[-1][1]
    assert len(worker.line.opened) == 2  # once more, for one loss
