"""Commands that wait together: one write for each station, and the reads after the writes."""

import random

import pytest
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
)
from bridge.simulator.faults import is_write

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 102.0  # when commands come: long after the modules are online
END = T + 3.0
EACH_S = 3.5
BOTH = [LineProtocol.WISCO, LineProtocol.MODBUS_RTU]
every_protocol = pytest.mark.parametrize("protocol", list(LineProtocol), ids=str)


def make_worker(
    protocol: LineProtocol,
    *models: ModuleType,
    baud: int = 9600,
    outputs: tuple[OutputConfig, ...] | None = None,
    wisco_only: bool = False,
) -> VirtualWorker:
    """A worker with modules `s1`, `s2`, ... of these kinds."""
    stations = (make_station(n, model, outputs=outputs) for n, model in enumerate(models, 1))
    line = make_line(*stations, protocol=protocol, baud=baud)
    return VirtualWorker(line, wisco_only=wisco_only)


def frames(worker: VirtualWorker, since: float = T) -> str:
    """What went out from an instant on: W for a write, r for anything else."""
    sent = [frame for at, frame in worker.line.wire if at >= since]
    return "".join("W" if is_write(frame) else "r" for frame in sent)


def scene(worker: VirtualWorker, values: int, at: float = T, stations: int = 1) -> None:
    """Every output of every station by a command of its own, all at once."""
    for n in range(1, stations + 1):
        for output in range(worker.line.modules[n].model.outputs):
            bit = 1 << output
            worker.command_at(
                at, bit, values & bit, station_id=f"s{n}", command_id=f"{n}/{output}/{at}"
            )


def judged(worker: VirtualWorker) -> dict[object, tuple[Status, Reason | None]]:
    """The one verdict on each mark."""
    verdicts = worker.verdicts()
    found: dict[object, tuple[Status, Reason | None]] = {
        verdict.id: (verdict.status, verdict.reason) for verdict in verdicts
    }
    assert len(found) == len(verdicts)
    return found


@every_protocol
def test_sixteen_commands_for_one_module_take_one_write_and_one_read(
    protocol: LineProtocol,
) -> None:
    """All outputs of a DO100 ON by 16 messages at 9600 baud: `done` within 200 ms."""
    worker = make_worker(protocol, DO100)
    scene(worker, 0xFFFF)
    worker.run(END)
    assert frames(worker).startswith("Wr")
    assert len(worker.writes()) == 1
    assert set(judged(worker).values()) == {(Status.DONE, None)}
    assert len(worker.verdicts()) == 16
    assert max(verdict.ms for verdict in worker.verdicts()) <= 200
    assert worker.line.modules[1].outputs == 0xFFFF


@every_protocol
def test_all_writes_go_before_the_first_read(protocol: LineProtocol) -> None:
    """Four modules, 64 commands: four writes, four reads, all `done` within 600 ms."""
    worker = make_worker(protocol, DO100, DO100, DO100, DO100)
    scene(worker, 0xFFFF, stations=4)
    worker.run(END)
    assert frames(worker).startswith("WWWWrrrr")
    assert len(worker.writes()) == 4
    assert len(worker.verdicts()) == 64
    assert set(judged(worker).values()) == {(Status.DONE, None)}
    assert max(verdict.ms for verdict in worker.verdicts()) <= 600


@pytest.mark.parametrize("model", [DIO100, DO100], ids=lambda model: model.name)
def test_modules_that_take_no_modbus_frames_are_told_all_in_one_wdox(model: ModuleType) -> None:
    """Their modes are not known: each output is named once, and nothing is said again."""
    worker = make_worker(LineProtocol.WISCO, model, wisco_only=True)
    worker.fault_on_writes(Fault.LOSE_REQUEST)
    scene(worker, 0b101)
    worker.run(END)
    assert len(worker.writes()) == 1
    assert worker.line.modules[1].ordered == {}
    assert set(judged(worker).values()) == {(Status.UNKNOWN, Reason.NO_REPLY)}


@every_protocol
def test_the_new_state_is_told_before_the_verdicts(protocol: LineProtocol) -> None:
    """One change with all outputs, then one verdict for each command."""
    worker = make_worker(protocol, DIO100)
    scene(worker, 0xFF)
    worker.run(END)
    told = worker.reported(T)
    assert told[0] == ValuesChanged("s1", 0, 0xFF)
    assert told[1:9] == worker.verdicts()


def test_over_modbus_only_neighbours_share_a_frame() -> None:
    """Outputs that were not named are not written: a frame for each run, and one read."""
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100)
    worker.line.modules[1].set_output(3, True)
    for output in (1, 6, 2, 7):
        worker.command_at(T, 1 << (output - 1), 1 << (output - 1), command_id=str(output))
    worker.run(END)
    assert frames(worker).startswith("WWr")
    assert worker.line.modules[1].outputs == 0b0110_0111
    assert set(judged(worker).values()) == {(Status.DONE, None)}
    assert {output for output, _ in worker.line.modules[1].ordered} == {1, 2, 6, 7}


# --- the order ------------------------------------------------------------------------------------


def test_what_goes_alone_keeps_its_place() -> None:
    """ON 1, ON 2, TOGGLE 3, ON 4: nothing behind the TOGGLE goes before it."""
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100)
    worker.command_at(T, 0b1, 0b1)
    worker.command_at(T, 0b10, 0b10)
    worker.command_at(T, 0b100, word=Word.TOGGLE)
    worker.command_at(T, 0b1000, 0b1000)
    worker.run(END)
    assert frames(worker).startswith("WrrWrWr")
    switched = [(s.output, s.value) for s in worker.line.modules[1].switchings]
    assert switched == [(1, True), (2, True), (3, True), (4, True)]


def test_a_known_pulse_goes_alone() -> None:
    """PRESS, and ON for what was read as a pulse: a frame and a read for each, sent once."""
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100)
    worker.line.modules[1].set_mode(3, pulse=True, hold_s=5.0)
    for output in (1, 2, 3, 4):
        worker.command_at(T, 1 << (output - 1), 1 << (output - 1), command_id=str(output))
    worker.run(END)
    assert len(worker.writes()) == 3
    assert worker.line.modules[1].ordered == {(n, True): 1 for n in (1, 2, 3, 4)}


def test_a_command_between_a_write_and_its_read_goes_out_first() -> None:
    """Another output of the same module: one read serves both."""
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100)
    worker.command_at(T, 1, 1, command_id="first")
    worker.command_at(T + 0.02, 0b100, 0b100, command_id="second")
    worker.run(END)
    assert frames(worker).startswith("WWr")
    assert set(judged(worker).values()) == {(Status.DONE, None)}


@pytest.mark.parametrize("first_lost", [False, True])
def test_another_word_for_the_same_output_waits_for_the_read(first_lost: bool) -> None:
    """ON is judged before OFF goes out, and not said again where it was lost."""
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100)
    worker.fault_on_writes(Fault.LOSE_REQUEST if first_lost else None)
    worker.command_at(T, 1, 1, command_id="on")
    worker.command_at(T + 0.03, 1, 0, command_id="off")
    worker.run(END)
    lost = (Status.FAILED, Reason.NOT_CONFIRMED)
    assert judged(worker) == {
        "on": lost if first_lost else (Status.DONE, None),
        "off": (Status.DONE, None),
    }
    assert len(worker.writes()) == 2
    assert worker.line.modules[1].outputs == 0


def test_commands_that_keep_coming_hold_no_verdict_up() -> None:
    """A command each 20 ms for 1.5 s, to 16 modules in turn: each is judged within 0.8 s."""
    worker = make_worker(LineProtocol.MODBUS_RTU, *[DIO100] * 16, baud=57600)
    for n in range(75):
        bit = 1 << (n // 16)
        worker.command_at(T + n * 0.02, bit, bit, station_id=f"s{n % 16 + 1}", command_id=str(n))
    worker.run(END)
    assert set(judged(worker).values()) == {(Status.DONE, None)}
    assert max(verdict.ms for verdict in worker.verdicts()) <= 800


# --- what is lost ---------------------------------------------------------------------------------


@every_protocol
@pytest.mark.parametrize("fault", [Fault.LOSE_REQUEST, Fault.LOSE_REPLY], ids=lambda f: f.name)
def test_a_lost_write_is_said_once_more_and_the_others_do_not_wait(
    protocol: LineProtocol, fault: Fault
) -> None:
    """The other module is written and judged before the one that did not acknowledge is read."""
    worker = make_worker(protocol, DIO100, DIO100)
    worker.fault_on_writes(fault)
    scene(worker, 0xFF, stations=2)
    worker.run(END)
    assert set(judged(worker).values()) == {(Status.DONE, None)}
    assert [verdict.station_id for verdict in worker.verdicts()] == ["s2"] * 8 + ["s1"] * 8
    assert len(worker.writes()) == (3 if fault is Fault.LOSE_REQUEST else 2)
    assert worker.line.modules[1].outputs == worker.line.modules[2].outputs == 0xFF


def test_of_a_lost_write_only_what_still_counts_is_said_again() -> None:
    """A newer word for output 1 waits, and the time of output 2 is over: 3 alone is repeated."""
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100)
    worker.fault_on_writes(Fault.LOSE_REQUEST)
    worker.command_at(T, 0b1, 0b1, command_id="1")
    worker.command_at(T, 0b10, 0b10, command_id="2", deadline_s=0.15)
    worker.command_at(T, 0b100, 0b100, command_id="3")
    worker.command_at(T + 0.1, 0b1, 0, command_id="newer")
    worker.run(END)
    assert judged(worker) == {
        "1": (Status.FAILED, Reason.NOT_CONFIRMED),
        "2": (Status.FAILED, Reason.NOT_CONFIRMED),
        "3": (Status.DONE, None),
        "newer": (Status.DONE, None),
    }
    assert worker.line.modules[1].ordered == {(3, True): 1, (1, False): 1}


def test_what_became_a_pulse_is_not_said_again() -> None:
    """A tool changed a mode between write and read: it may have had its ON (promise 1)."""
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100)
    module = worker.line.modules[1]
    worker.fault_on_writes(Fault.LOSE_REQUEST)
    worker.line.at(T + 0.05, lambda: module.set_mode(2, pulse=True, hold_s=1.0))
    scene(worker, 0xFF)
    worker.run(END)
    assert (2, True) not in module.ordered
    assert module.outputs == 0xFD
    found = judged(worker)
    assert found.pop(f"1/1/{T}") == (Status.UNKNOWN, Reason.NO_REPLY)
    assert set(found.values()) == {(Status.DONE, None)}


@every_protocol
def test_a_dead_module_costs_the_scene_one_time_out(protocol: LineProtocol) -> None:
    """It died just now: the others are judged after its one write in vain, and before its reads."""
    worker = make_worker(protocol, *[DIO100] * 4, baud=57600)
    worker.line.at(T - 0.001, lambda: setattr(worker.line.modules[1], "away", True))
    scene(worker, 0xFF, stations=4)
    worker.run(END)
    by_station = {n: [v for v in worker.verdicts() if v.station_id == f"s{n}"] for n in range(1, 5)}
    assert {(v.status, v.reason) for v in by_station[1]} == {(Status.UNKNOWN, Reason.NO_REPLY)}
    assert max(v.ms for v in by_station[1]) < 2000
    for n in (2, 3, 4):
        assert {v.status for v in by_station[n]} == {Status.DONE}
        assert max(v.ms for v in by_station[n]) <= 350
    assert sum(is_write(frame) for _, frame in worker.line.wire) == 4


@every_protocol
@pytest.mark.parametrize("fault", [Fault.PORT_GONE, Fault.PORT_GONE_AFTER], ids=lambda f: f.name)
@pytest.mark.parametrize("at", [2, 4], ids=["at a write", "at a read"])
def test_a_port_that_goes_in_a_scene_leaves_what_was_sent_unknown(
    protocol: LineProtocol, fault: Fault, at: int
) -> None:
    """Each command has one verdict, and nothing is sent again (promise 4)."""
    worker = make_worker(protocol, DIO100, DIO100, DIO100)
    seen = 0

    def fail(_frame: bytes) -> Fault | None:
        nonlocal seen
        seen += worker.line.now >= T
        return fault if seen == at else None

    worker.line.fault = fail
    scene(worker, 0xFF, stations=3)
    worker.run(END)
    assert len(judged(worker)) == 24
    sent = [v for v in worker.verdicts() if v.status is Status.UNKNOWN]
    assert {v.reason for v in sent} == {Reason.PORT_DOWN}
    assert len(sent) == (16 if at == 2 else 24)
    assert len(worker.writes()) <= 3


def test_nothing_is_sent_after_the_deadline_of_any_of_them() -> None:
    """Some have 10 ms, and another command is under way: those are refused, the others go."""
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100)
    worker.command_at(T, 1, word=Word.TOGGLE, command_id="first")
    for output in range(2, 9):
        bit = 1 << (output - 1)
        short = output in {4, 5}
        worker.command_at(T, bit, bit, command_id=str(output), deadline_s=0.01 if short else 2.0)
    worker.run(END)
    found = judged(worker)
    assert found.pop("4") == found.pop("5") == (Status.REFUSED, Reason.EXPIRED)
    assert set(found.values()) == {(Status.DONE, None)}
    assert worker.line.modules[1].outputs == 0b1110_0111


def test_a_stop_judges_what_is_out() -> None:
    """Writes that were sent are read back before the line ends; the rest is `stopping`."""
    worker = make_worker(LineProtocol.MODBUS_RTU, *[DIO100] * 4)
    scene(worker, 0xFF, stations=4)
    worker.run(T + 0.04)
    found = set(judged(worker).values())
    assert found == {(Status.DONE, None), (Status.REFUSED, Reason.STOPPING)}
    assert len(worker.verdicts()) == 32


def test_max_on_is_not_taken_for_a_write_that_was_lost() -> None:
    """Its OFF falls due while an ON waits for its read: the ON is judged, and not said again."""
    outputs = (OutputConfig(1, max_on_s=1.0), *(OutputConfig(n) for n in range(2, 9)))
    worker = make_worker(LineProtocol.MODBUS_RTU, DIO100, DIO100, outputs=outputs)
    worker.command_at(T, 1, 1, command_id="begins")
    for n in range(10):
        worker.command_at(T + 0.9 + n * 0.02, 1, 1, command_id=f"again {n}")
        worker.command_at(T + 0.9 + n * 0.02, 2, 2, station_id="s2", command_id=f"other {n}")
    worker.run(T + 8)
    assert worker.line.modules[1].outputs & 1 == 0


# --- for ever -------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", BOTH, ids=str)
def test_all_off_after_all_on_leaves_nothing_on(protocol: LineProtocol) -> None:
    """OFF 0-1 s behind ON in steps of 50 ms, 5 % of the replies lost: one verdict for each."""
    assert left_on(protocol, 21) == 0


def left_on(protocol: LineProtocol, times: int) -> int:
    """Switch 32 outputs ON and OFF, so many times; return how many relays stayed ON."""
    chance = random.Random(12)  # noqa: S311  # losses, not secrets
    worker = make_worker(protocol, DO100, DO100)
    worker.line.fault = lambda _: Fault.LOSE_REPLY if chance.random() < 0.05 else None
    left: list[int] = []
    for n in range(times):
        at = T + n * EACH_S
        scene(worker, 0xFFFF, at, stations=2)
        scene(worker, 0, at + n % 21 * 0.05 + 0.001, stations=2)
        worker.line.at(
            at + EACH_S - 0.1, lambda: left.extend(m.outputs for m in worker.line.modules.values())
        )
    worker.run(T + times * EACH_S)
    assert len(left) == 2 * times
    assert len(judged(worker)) == 64 * times
    return sum(outputs.bit_count() for outputs in left)
