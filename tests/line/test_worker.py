import logging
import re
from collections import Counter
from dataclasses import replace
from functools import partial
from itertools import pairwise

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import OutputConfig
from bridge.model import (
    DIO100,
    DO100,
    LineChanged,
    LineProtocol,
    ModuleType,
    OutputSettings,
    ProblemChanged,
    Reason,
    SettingsRead,
    StationChanged,
    Status,
    ValuesChanged,
    Verdict,
    Word,
    Writes,
)
from bridge.simulator.faults import is_write
from bridge.simulator.module import SimulatedModule

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 103.0
LATER = 110.0  # the port has held for long enough to be told at once
PROTOCOLS = list(LineProtocol)


# --- coming up ------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_module_comes_up_with_its_states_before_online(protocol: LineProtocol) -> None:
    """Settings, values, no problem, and only then online (docs/contract.md, Order and truth)."""
    worker = VirtualWorker(make_line(make_station(), make_station(2, DO100), protocol=protocol))
    worker.line.modules[1].set_input(3, True)
    worker.line.modules[2].set_output(16, True)
    worker.run(105.0)
    settings = OutputSettings(0, (10,) * 8), OutputSettings(0, (10,) * 16)
    assert worker.reported() == [
        LineChanged("main", online=True, detail="/dev/rs485"),
        SettingsRead("s1", settings[0]),
        ValuesChanged("s1", 4, 0),
        ProblemChanged("s1", None, ""),
        StationChanged("s1", online=True, detail=""),
        SettingsRead("s2", settings[1]),
        ValuesChanged("s2", 0, 0x8000),
        ProblemChanged("s2", None, ""),
        StationChanged("s2", online=True, detail=""),
    ]


@pytest.mark.parametrize(
    ("mode_1", "hold_1_s", "mode_2", "detail"),
    [
        (
            "latch",
            None,
            "pulse",
            "output 1 is in pulse mode, declared latch; output 2 is in latch mode, declared pulse",
        ),
        ("pulse", 0.5, None, "output 1 holds 0.7 s, declared 0.5 s"),
    ],
)
def test_declared_settings_that_differ_are_a_problem(
    mode_1: str, hold_1_s: float | None, mode_2: str | None, detail: str
) -> None:
    """Compared with the module, named, never written (docs/configuration.md)."""
    outputs = (
        OutputConfig(1, mode=mode_1, hold_s=hold_1_s),
        OutputConfig(2, mode=mode_2, hold_s=0.3),
        OutputConfig(3, mode="pulse", hold_s=2.5),
        OutputConfig(4),
    )
    worker = VirtualWorker(make_line(make_station(outputs=outputs)))
    worker.line.modules[1].set_mode(1, pulse=True, hold_s=0.7)
    worker.line.modules[1].set_mode(2, pulse=False, hold_s=0.3)
    worker.line.modules[1].set_mode(3, pulse=True, hold_s=2.5)
    worker.run(105.0)
    (problem,) = [e for e in worker.reported() if isinstance(e, ProblemChanged)]
    assert (problem.reason, problem.detail) == ("settings_differ", detail)
    assert worker.online_at()[0][1]
    assert worker.writes() == []


def test_a_dead_module_delays_nobody_and_is_met_when_it_comes() -> None:
    """Nothing of it is published before its first good read."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2)))
    worker.line.modules[1].away = True
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", False))
    worker.run(T + 35)
    assert worker.online_at("s2")[0][0] < 101.0
    ((came_at, online),) = worker.online_at("s1")
    assert online
    assert T < came_at < T + 30


# --- polling --------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_change_is_reported_once_and_soon(protocol: LineProtocol) -> None:
    """Within a round and the second read; unchanged reads report nothing."""
    worker = VirtualWorker(make_line(protocol=protocol))
    worker.line.at(T, lambda: worker.line.modules[1].set_input(9, True))
    worker.run(T + 5)
    ((at, event),) = [(at, event) for at, event in worker.events if at >= T]
    assert event == ValuesChanged("s1", 1 << 8, 0)
    assert at - T < 0.2


def test_a_silent_module_goes_offline_and_comes_back() -> None:
    """Its last states stay as they were; coming back, it is read anew before it is online."""
    worker = VirtualWorker()
    module = worker.line.modules[1]
    worker.line.at(T, lambda: setattr(module, "away", True))
    worker.line.at(T + 8, lambda: module.set_input(1, True))
    worker.line.at(T + 8, lambda: setattr(module, "away", False))
    worker.run(T + 20)
    problem, gone, *back = worker.reported(T)
    assert problem == ProblemChanged("s1", "no_reply", "station 1 did not answer")
    assert isinstance(gone, StationChanged)
    assert (gone.station_id, gone.online) == ("s1", False)
    assert "did not answer" in gone.detail
    assert [type(event) for event in back] == [
        SettingsRead,
        ValuesChanged,
        ProblemChanged,
        StationChanged,
    ]
    assert back[1] == ValuesChanged("s1", 1, 0)
    assert back[2] == ProblemChanged("s1", None, "")
    (_, (gone_at, _), (back_at, _)) = worker.online_at()
    assert 2.0 <= gone_at - T <= 5.0
    assert back_at - (T + 8) <= 8.0


def test_a_cut_cable_takes_every_module_offline() -> None:
    """All within 5 s, each with its own words; then they come back one after the other."""
    worker = VirtualWorker(make_line(*[make_station(n) for n in range(1, 13)]))
    for module in worker.line.modules.values():
        worker.line.at(T, lambda module=module: setattr(module, "away", True))  # type: ignore[misc]  # a lambda with a default
        worker.line.at(T + 20, lambda module=module: setattr(module, "away", False))  # type: ignore[misc]  # as above
    worker.run(T + 60)
    gone = [e for e in worker.reported(T) if isinstance(e, StationChanged) and not e.online]
    assert {event.station_id for event in gone} == {f"s{n}" for n in range(1, 13)}
    for n in range(1, 13):
        (_, (gone_at, _), (_, online)) = worker.online_at(f"s{n}")
        assert gone_at - T <= 5.0
        assert online
    for event in gone:
        assert event.detail in {
            f"station {event.station_id[1:]} did not answer",
            "no module on the line answers",
        }


# --- the wrong model ------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_the_wrong_model_is_a_problem_and_is_never_written(protocol: LineProtocol) -> None:
    """It stays offline, is named once, and is met when the right one is there."""
    worker = VirtualWorker(make_line(protocol=protocol))
    right = worker.line.modules[1]
    wrong = SimulatedModule(DO100, 1, clock=worker.line.clock)
    worker.line.modules[1] = wrong
    worker.command_at(T, 1, 1)
    worker.line.at(T + 10, lambda: worker.line.modules.update({1: right}))
    worker.run(T + 60)
    _, problem, verdict, *met = worker.reported()
    assert isinstance(problem, ProblemChanged)
    assert problem.reason == "wrong_model"
    assert "configured as DIO100" in problem.detail
    assert isinstance(verdict, Verdict)
    assert (verdict.status, verdict.reason) == (Status.REFUSED, Reason.WRONG_MODEL)
    assert met[2:] == [
        ProblemChanged("s1", None, ""),
        StationChanged("s1", online=True, detail=""),
    ]
    assert wrong.ordered == {}


@pytest.mark.parametrize(("model", "other"), [(DIO100, DO100), (DO100, DIO100)])
def test_a_module_that_is_swapped_while_online_is_found_out(
    model: ModuleType, other: ModuleType
) -> None:
    """Its successor is known for what it is at the first reply that does not fit."""
    worker = VirtualWorker(make_line(make_station(model=model)))
    successor = SimulatedModule(other, 1, clock=worker.line.clock)
    worker.line.at(T, lambda: worker.line.modules.update({1: successor}))
    worker.command_at(T + 8, 1, 1)
    worker.run(T + 10)
    gone, problem, verdict = worker.reported(T)
    assert isinstance(gone, StationChanged)
    ((gone_at, _),) = [each for each in worker.events if each[1] is gone]
    assert gone_at < T + 2.5  # outputs are swept
    assert isinstance(problem, ProblemChanged)
    assert problem.reason == "wrong_model"
    assert isinstance(verdict, Verdict)
    assert verdict.reason is Reason.WRONG_MODEL
    assert successor.ordered == {}


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_module_whose_replies_are_all_damaged_is_told_as_maybe_two(
    protocol: LineProtocol,
) -> None:
    """As two with one address answer, where they differ: one that is silent is told without it."""
    for fault, hinted in ((Fault.GARBLE_REPLY, True), (Fault.LOSE_REPLY, False)):
        worker = VirtualWorker(make_line(protocol=protocol))
        worker.line.at(T, partial(setattr, worker.line, "fault", lambda _, fault=fault: fault))
        worker.run(T + 10)
        (problem,) = [e for e in worker.reported(T) if isinstance(e, ProblemChanged)]
        assert problem.reason == "no_reply"
        assert ("two modules may share address 1" in problem.detail) is hinted


def test_a_wrong_model_is_named_once_though_the_line_is_bad() -> None:
    """Contacts that fail in between do not make it news again."""
    worker = VirtualWorker()
    worker.line.modules[1] = SimulatedModule(DO100, 1, clock=worker.line.clock)
    worker.line.at(T, lambda: setattr(worker.line, "fault", lambda _: Fault.LOSE_REPLY))
    worker.line.at(T + 60, lambda: setattr(worker.line, "fault", lambda _: None))
    worker.run(T + 200)
    assert len([e for e in worker.reported() if isinstance(e, ProblemChanged)]) == 1


# --- the port -------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_lost_port_takes_its_modules_and_then_the_line_offline(protocol: LineProtocol) -> None:
    """Then it is opened anew, everything is read anew, and no relay was switched (promise 4)."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2), protocol=protocol))
    worker.line.modules[1].set_output(1, True)

    def pull() -> None:
        worker.line.open_error = "no such device"
        worker.line.fault = lambda _: Fault.PORT_GONE

    def plug() -> None:
        worker.line.open_error = None
        worker.line.fault = lambda _: None

    worker.line.at(LATER, pull)
    worker.line.at(LATER + 30, plug)
    worker.run(LATER + 40)
    first, second, third, fourth, *back = worker.reported(LATER)
    assert isinstance(first, StationChanged)
    assert isinstance(second, StationChanged)
    assert third == LineChanged("main", online=False, detail="the port is gone")
    assert fourth == LineChanged("main", online=True, detail="/dev/rs485")
    assert [type(event) for event in back] == [
        SettingsRead,
        ValuesChanged,
        ProblemChanged,
        StationChanged,
    ] * 2
    assert worker.writes() == []
    for station_id in ("s1", "s2"):
        came_back_at, online = worker.online_at(station_id)[-1]
        assert online
        assert came_back_at - (LATER + 30) <= 5.0
        assert came_back_at - worker.line.opened[-1] <= 1.0
    assert worker.line.closed == 2


def test_a_port_is_opened_again_soon_and_then_every_two_seconds() -> None:
    """0.25, 0.5, 1, 2, 2 ... for ever; an adapter that is absent at start is no exit."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.run(110.0)
    opened = worker.line.opened
    pauses = [later - earlier for earlier, later in pairwise(opened)]
    assert pauses == pytest.approx([0.25, 0.5, 1, 2, 2, 2, 2])
    assert worker.reported() == [
        LineChanged("main", online=False, detail="/dev/rs485: no such device")
    ]
    assert worker.line.closed == 0


def test_a_port_that_opens_and_fails_at_once_is_not_up() -> None:
    """A gateway that hangs up on everybody: said once, and tried every two seconds."""
    worker = VirtualWorker()
    worker.line.fault = lambda _: Fault.PORT_GONE
    worker.run(160.0)
    assert worker.reported() == [LineChanged("main", online=False, detail="the port is gone")]
    assert 20 <= len(worker.line.opened) <= 40
    assert worker.line.closed == len(worker.line.opened)


def test_a_port_that_goes_while_a_module_is_met_leaves_nothing_of_it() -> None:
    """What was read before counts for nothing: a stranger may be there when it is back."""
    worker = VirtualWorker()
    left = [None, None, None, Fault.PORT_GONE]
    worker.line.fault = lambda _: left.pop(0) if left else None
    worker.line.at(100.2, lambda: worker.line.modules[1].set_input(1, True))
    worker.run(105.0)
    assert [e for e in worker.reported() if isinstance(e, ValuesChanged)] == [
        ValuesChanged("s1", 1, 0)
    ]


def test_the_line_is_up_when_nobody_answers() -> None:
    """The port is there: that the modules are not is another matter."""
    worker = VirtualWorker()
    worker.line.modules[1].away = True
    worker.run(105.0)
    assert worker.reported() == [
        LineChanged("main", online=True, detail="/dev/rs485"),
        ProblemChanged("s1", "no_reply", "station 1 did not answer"),
    ]


def test_a_port_that_had_held_is_opened_again_soon() -> None:
    """A back-off of long ago is forgotten."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.line.at(120.0, lambda: setattr(worker.line, "open_error", None))
    left = [Fault.PORT_GONE]
    worker.line.at(
        140.0, lambda: setattr(worker.line, "fault", lambda _: left.pop() if left else None)
    )
    worker.run(145.0)
    lost_at = next(at for at, e in worker.events if at >= 140.0 and isinstance(e, LineChanged))
    assert worker.line.opened[-1] - lost_at == pytest.approx(0.25)


def test_commands_while_the_port_is_gone_are_refused_at_once() -> None:
    """Those that waited too: none is carried out later (promise 2)."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.command_at(103.4, 1, 1)
    worker.line.at(104.0, lambda: setattr(worker.line, "open_error", None))
    worker.run(110.0)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason, verdict.ms) == (Status.REFUSED, Reason.OFFLINE, 0)
    assert worker.writes() == []


def test_commands_that_wait_when_the_port_goes_are_refused_at_once() -> None:
    """They get their verdicts before the pause, not after it."""
    worker = VirtualWorker(make_line(protocol=LineProtocol.MODBUS_RTU))
    worker.fault_on_writes(Fault.PORT_GONE)
    for n, command_id in enumerate("abc"):
        worker.command_at(T, 1 << n, word=Word.TOGGLE, command_id=command_id)
    worker.run(T + 5)
    assert [(v.id, v.status, v.reason) for v in worker.verdicts()] == [
        ("a", Status.UNKNOWN, Reason.PORT_DOWN),
        ("b", Status.REFUSED, Reason.OFFLINE),
        ("c", Status.REFUSED, Reason.OFFLINE),
    ]
    assert all(verdict.ms < 100 for verdict in worker.verdicts())
    assert worker.writes() == []


# --- commands -------------------------------------------------------------------------------------


def test_commands_for_a_dying_module_let_the_others_go_first() -> None:
    """Ten commands for a module that just died: the one for the live module is done in 2 s."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2)))
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", True))
    for n in range(8):
        worker.command_at(T + 0.5, 1 << n, 1 << n, station_id="s1")
    worker.command_at(T + 0.6, 1, 1, station_id="s2", command_id="live")
    worker.run(T + 10)
    live = next(verdict for verdict in worker.verdicts() if verdict.id == "live")
    assert live.status is Status.DONE
    assert live.ms < 2000
    assert len(worker.verdicts()) == 9
    ended = {(v.status, v.reason) for v in worker.verdicts() if v.id != "live"}
    assert ended <= {
        (Status.UNKNOWN, Reason.NO_REPLY),
        (Status.REFUSED, Reason.EXPIRED),
        (Status.REFUSED, Reason.OFFLINE),
    }


def test_what_expires_behind_a_module_that_dies_is_refused_then() -> None:
    """A verdict is due within the deadline and one write (promise 3), whatever else is ordered."""
    outputs = tuple(OutputConfig(n, max_on_s=10.0 if n < 4 else None) for n in range(1, 9))
    worker = VirtualWorker(make_line(make_station(outputs=outputs), baud=4800, writes=Writes.WISCO))
    worker.line.modules[1].write_outputs(0b111, 0b111, b"")
    worker.line.at(T - 0.5, lambda: setattr(worker.line.modules[1], "away", True))
    for n in range(4, 8):
        worker.command_at(T + 0.5, 1 << n, 1 << n, command_id=f"{n}")
    worker.run(T + 15)
    told = [verdict.ms for verdict in worker.verdicts() if verdict.by is None]
    assert len(told) == 4
    assert max(told) < 2000 + 2200


def test_commands_for_the_only_module_do_not_spin_while_it_is_dying() -> None:
    """Nothing is due and no other module waits: they are carried out, each with its verdict."""
    worker = VirtualWorker()
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", True))
    for n in range(8):
        worker.command_at(T + 0.5, 1 << n, 1 << n, deadline_s=10.0)
    worker.run(T + 15)
    assert len(worker.verdicts()) == 8


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_commands_for_a_silent_module_do_not_keep_it_online(protocol: LineProtocol) -> None:
    """Offline within 5 s, however many commands come (promise 7): what they ask counts too."""
    worker = VirtualWorker(make_line(protocol=protocol, baud=4800))
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", True))
    for n in range(40):
        worker.command_at(T + 0.3 * n, 1 << n % 8, 0, word=Word.TOGGLE)
    worker.run(T + 12)
    (offline_at,) = [at for at, online in worker.online_at() if not online]
    assert T + 2 <= offline_at <= T + 5


def test_a_command_goes_out_first_after_a_late_window() -> None:
    """While no request may be sent the queue is looked at: the write comes before the poll."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2), writes=Writes.WISCO))
    lost = [Fault.LOSE_REPLY]
    worker.line.fault = lambda _: lost.pop() if lost and worker.line.now >= T else None
    worker.command_at(T + 0.3, 1, 1)
    worker.run(T + 2)
    first = next(frame for at, frame in worker.line.wire if at > T + 0.15)
    assert [first] == worker.writes()


def waiting_for_a_late_reply(*wisco_only: int) -> tuple[VirtualWorker, list[tuple[float, bytes]]]:
    """Three modules, and what is sent from the miss of s1 until no late reply can come."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2), make_station(3)))
    for address in wisco_only:
        worker.line.modules[address].wisco_only = True
    quiet = list[tuple[float, bytes]]()

    def fault(frame: bytes) -> Fault | None:
        line = worker.line
        if T <= line.now < line.quiet_until:
            quiet.append((line.now, frame))
        lost = line.now >= T and line.quiet_until < T and frame.startswith(b"#01")
        return Fault.LOSE_REPLY if lost else None

    worker.line.fault = fault
    return worker, quiet


def test_while_a_late_reply_may_come_the_others_are_read_in_frames_that_say_whose() -> None:
    """A Wisco reply does not: such frames rest (promise 5), and an input is seen all the same."""
    worker, quiet = waiting_for_a_late_reply()
    worker.line.at(T + 0.2, lambda: worker.line.modules[2].set_input(5, True))
    worker.run(T + 2)
    assert {frame[:3] for _, frame in quiet} == {b":02", b":03"}
    assert len(quiet) >= 4
    (seen_at,) = [at for at, event in worker.events if event == ValuesChanged("s2", 16, 0)]
    assert T + 0.2 < seen_at < worker.line.quiet_until
    assert worker.line.wire[-1][1].startswith(b"#")


def test_a_command_does_not_wait_until_no_late_reply_can_come() -> None:
    """Its frames say whose they are; nothing is asked of a module that takes no such frames."""
    worker, quiet = waiting_for_a_late_reply(2)
    worker.command_at(T + 0.2, 1, 1, station_id="s3")
    worker.run(T + 2)
    (write,) = worker.writes()
    (written_at,) = [at for at, frame in quiet if frame == write]
    assert T + 0.2 <= written_at < T + 0.25
    assert {frame[:3] for _, frame in quiet} == {b":03"}
    assert worker.verdict().status is Status.DONE


def test_a_module_that_takes_no_such_frames_keeps_no_other_waiting() -> None:
    """Its turn comes when no late reply can: meanwhile the others are read on."""
    worker, quiet = waiting_for_a_late_reply(2)
    worker.run(T + 2)
    assert {frame[:3] for _, frame in quiet} == {b":03"}
    asked = [at for at, _ in (*quiet, (worker.line.quiet_until, b""))]
    assert max(later - at for at, later in pairwise(asked)) < 0.06
    after = [(at, frame) for at, frame in worker.line.wire if at >= worker.line.quiet_until]
    assert any(frame.startswith(b"#02") for _, frame in after[:2])  # a retry of s1 may be first


def test_modules_that_were_dead_since_the_start_hold_a_line_for_one_time_out_each() -> None:
    """Probes in vain delay the others by no more, though station 0 takes no Modbus frames."""
    worker = VirtualWorker(make_line(*(make_station(n) for n in range(32)), baud=57600))
    for address in (5, 15):
        worker.line.modules[address].away = True
    worker.run(T + 80)
    wire = [(at, int(frame[1:3], 16), frame[:1]) for at, frame in worker.line.wire if at >= T]
    longest = Counter[bool]()
    for (at, address, _), (later, *_) in pairwise(wire):
        probed = address in {5, 15}
        longest[probed] = max(longest[probed], round((later - at) * 1000))
    assert longest[True] <= 115
    assert longest[False] <= 20
    probes = [mark for _, address, mark in wire if address in {5, 15}]
    assert probes.count(b"#") <= 6  # these make the reads slower for the late window


@pytest.mark.parametrize("back_s", [0.3, 2.0, 9.0, 20.0, 35.0, 70.0])
def test_a_module_that_takes_wisco_frames_alone_is_found_within_30_s(back_s: float) -> None:
    """It was dead since the start, so what it takes is not known."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2)))
    module = worker.line.modules[2]
    module.wisco_only = module.away = True
    worker.line.at(100.0 + back_s, lambda: setattr(module, "away", False))
    worker.run(100.0 + back_s + 32.0)
    ((came_at, online),) = worker.online_at("s2")
    assert online
    assert 0.0 < came_at - 100.0 - back_s <= 31.0  # with the reads of the contact


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
@pytest.mark.parametrize(("baud", "most_s"), [(57600, 45.0), (4800, 60.0)])
def test_dead_modules_take_a_tenth_of_a_wisco_line_and_are_found_again(
    baud: int, most_s: float
) -> None:
    """Of 32 modules 31 die: what is asked in vain is limited (promise 7), docs/failures.md D1."""
    worker = VirtualWorker(make_line(*(make_station(n) for n in range(1, 32)), baud=baud))
    modules = worker.line.modules
    for n in range(2, 32):
        worker.line.at(T, partial(setattr, modules[n], "away", True))
    back_at = T + 100.0
    worker.line.at(back_at, lambda: setattr(modules[9], "away", False))
    worker.run(back_at + most_s)
    asked = [(at, int(frame[1:3], 16)) for at, frame in worker.line.wire]
    vain_s = sum(
        later - at
        for (at, address), (later, _) in pairwise(asked)
        if T + 20 <= at < back_at and address != 1
    )
    watched_s = back_at - T - 20
    assert 0.05 * watched_s < vain_s <= 0.1 * watched_s + 0.2  # one probe begins at its end
    living = [at for at, address in asked if T + 20 <= at < back_at and address == 1]
    assert max(later - at for at, later in pairwise(living)) < 0.2 + 80 * 10 / baud
    assert any(at > back_at for at, online in worker.online_at("s9") if online)


def test_a_read_from_before_a_write_confirms_nothing_after_it() -> None:
    """The write cannot be checked: what its output is then is read twice anew.

    See docs/failures.md C2.
    """
    worker = VirtualWorker(make_line(writes=Writes.WISCO))
    module = worker.line.modules[1]
    reads: list[float] = []
    begun: list[float] = []

    def fault(frame: bytes) -> Fault | None:
        now = worker.line.now
        if is_write(frame):
            begun.append(now)
        elif frame == b"#01RDOH\r" and now >= T and not begun:
            # The change is seen once; before it is read again there comes a command.
            worker.command_at(now, 1, 1)
            module.set_output(1, True)
        elif frame == b"#01RDOH\r" and begun and now > begun[0] + 1.4:
            reads.append(now)
        return Fault.LOSE_REPLY if begun and now <= begun[0] + 1.4 else None

    worker.line.fault = fault
    worker.run(T + 10)
    assert worker.verdict().status is Status.UNKNOWN
    reported_at = next(at for at, e in worker.events if at >= T and isinstance(e, ValuesChanged))
    assert sum(at < reported_at for at in reads) == 2


def test_a_newer_wish_for_a_latch_supersedes_the_older() -> None:
    """The older gets its verdict, and is not sent."""
    worker = VirtualWorker(make_line(protocol=LineProtocol.MODBUS_RTU))
    worker.command_at(T, 0b10, 0b10, command_id="busy")
    worker.command_at(T, 1, 1, command_id="old")
    worker.command_at(T, 1, 0, command_id="new")
    worker.run(T + 2)
    assert {v.id: (v.status, v.reason) for v in worker.verdicts()} == {
        "busy": (Status.DONE, None),
        "old": (Status.REFUSED, Reason.SUPERSEDED),
        "new": (Status.DONE, None),
    }
    assert len(worker.writes()) == 1


@pytest.mark.parametrize("way", ["pulse", "unknown", "toggle", "press"])
def test_pulses_and_toggles_are_never_superseded(way: str) -> None:
    """Each is carried out, in its order."""
    writes = Writes.WISCO if way == "unknown" else Writes.AUTO
    worker = VirtualWorker(make_line(writes=writes))
    word = {"toggle": Word.TOGGLE, "press": Word.PRESS}.get(way)
    worker.line.modules[1].set_mode(1, pulse=way in {"pulse", "press"}, hold_s=0.1)
    for _ in range(3):
        worker.command_at(T, 1, 0 if word is Word.TOGGLE else 1, word=word)
    worker.run(T + 3)
    assert [verdict.status for verdict in worker.verdicts()] == [Status.DONE] * 3
    assert len(worker.writes()) == 3


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_flood_of_commands_starves_no_reading(protocol: LineProtocol) -> None:
    """20 commands a second for each of 8 modules, for 10 s: every module is read all along."""
    config = make_line(*[make_station(n) for n in range(1, 9)], protocol=protocol)
    worker = VirtualWorker(replace(config, output_sweep_s=0.0))
    for n in range(200):
        for address in range(1, 9):
            bit = 1 << n % 8
            worker.command_at(
                LATER + n / 20, bit, bit * (n // 8 & 1), station_id=f"s{address}", word=Word.TOGGLE
            )
    worker.run(LATER + 14)
    assert len(worker.verdicts()) == 1600
    assert not any(isinstance(event, StationChanged) for event in worker.reported(LATER))
    before = [frame for at, frame in worker.line.wire if 104 < at < 109]
    # Settings are asked for once a minute.
    polls: dict[bytes, list[float]] = {f: [] for f in before if before.count(f) > 1}
    assert len(polls) == 2 * 8
    cycle_s = 5.0 * len(polls) / len(before)
    for at, frame in worker.line.wire:
        if frame in polls and LATER + 2.1 < at < LATER + 10:
            polls[frame].append(at)
    for times in polls.values():
        assert max(later - earlier for earlier, later in pairwise(times)) < 2 * cycle_s + 0.5
    assert all(v.ms <= 2500 for v in worker.verdicts())


@pytest.mark.parametrize("lost", [3, 4])
def test_a_contact_that_loses_a_reply_is_repeated_soon(lost: int) -> None:
    """A module answers its probe, and a later reply of this contact is lost: it is back in 5 s."""
    worker = VirtualWorker(
        make_line(make_station(1), make_station(2), protocol=LineProtocol.MODBUS_RTU)
    )
    asked: list[float] = []

    def fault(frame: bytes) -> Fault | None:
        if frame[0] != 2 or worker.line.modules[2].away:
            return None
        asked.append(worker.line.now)
        return Fault.LOSE_REPLY if len(asked) == lost and asked[0] > T else None

    def set_away(away: bool) -> None:
        worker.line.modules[2].away = away
        asked.clear()

    worker.line.fault = fault
    worker.line.at(T, lambda: set_away(True))
    worker.line.at(T + 40, lambda: set_away(False))
    worker.run(T + 75)
    back = [at for at, online in worker.online_at("s2") if online and at > T + 40]
    assert back[0] - asked[0] < 5


def test_no_value_expires_when_commands_had_their_share() -> None:
    """Toggles use up the burst of two seconds; then an output of each of 16 modules goes OFF."""
    worker = VirtualWorker(make_line(*[make_station(n) for n in range(1, 32)]))
    for station in range(10, 32):
        worker.command_at(T, 1, station_id=f"s{station}", word=Word.TOGGLE)
    for station in range(1, 17):
        worker.command_at(T + 1.9, 2, 0, station_id=f"s{station}", command_id="off")
    worker.run(T + 6)
    off = [verdict.status for verdict in worker.verdicts() if verdict.id == "off"]
    assert off == [Status.DONE] * 16


@pytest.mark.parametrize("hold_s", [0.3, 1.0])
def test_the_end_of_a_pulse_is_read_when_it_is_due(hold_s: float) -> None:
    """Not with the next sweep: 8 modules on this line are swept in 60 s."""
    config = make_line(
        *[make_station(n) for n in range(1, 9)], protocol=LineProtocol.MODBUS_RTU, baud=57600
    )
    worker = VirtualWorker(replace(config, output_sweep_s=60.0))
    worker.line.modules[5].set_mode(2, pulse=True, hold_s=hold_s)
    worker.command_at(T, 2, word=Word.PRESS, station_id="s5")
    worker.run(T + 4)
    ended = worker.line.modules[5].switchings[-1].at
    (off_at,) = [
        at
        for at, event in worker.events
        if isinstance(event, ValuesChanged) and at > T and not event.outputs
    ]
    assert 0 <= off_at - ended <= 0.15


def test_a_station_whose_inputs_changed_is_read_again_soon() -> None:
    """A short pulse that began is seen to end within half a round."""
    config = make_line(
        *[make_station(n) for n in range(1, 32)], protocol=LineProtocol.MODBUS_RTU, baud=57600
    )
    worker = VirtualWorker(config)
    worker.line.at(T, lambda: worker.line.modules[9].set_input(1, True))
    worker.run(T + 2)
    seen_at = next(at for at, event in worker.events if isinstance(event, ValuesChanged) and at > T)
    reads = [at for at, frame in worker.line.wire if frame[:2] == b"\x09\x02" and at > seen_at]
    assert reads[0] - seen_at < 0.5 * (reads[2] - reads[1])


# --- the end --------------------------------------------------------------------------------------


def test_stopping_refuses_what_still_waits() -> None:
    """Each command gets its verdict, and nothing more is written (promise 3)."""
    worker = VirtualWorker(make_line(protocol=LineProtocol.MODBUS_RTU))
    for n in range(8):
        worker.command_at(T, 1 << n, word=Word.TOGGLE)  # these are not merged
    worker.run(T + 0.1)
    reasons = Counter(verdict.reason for verdict in worker.verdicts())
    assert sum(reasons.values()) == 8
    assert reasons[Reason.STOPPING] >= 5
    assert len(worker.writes()) == 8 - reasons[Reason.STOPPING]
    assert worker.line.closed == 1


def test_a_stop_while_the_port_is_gone_ends_the_wait() -> None:
    """Not after the pause: the service stops at once."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.run(103.9)
    assert worker.line.now == 103.9


def test_the_thread_runs_until_it_is_stopped() -> None:
    """Started, alive, making progress, stopped, joined."""
    worker = VirtualWorker()
    worker.line.at(100.5, worker.worker.stop)
    begun = worker.worker.progress
    assert not worker.worker.alive
    worker.worker.start()
    assert worker.worker.join(30.0)
    assert not worker.worker.alive
    assert worker.worker.failure is None
    assert worker.worker.progress > begun
    assert worker.line.closed == 1


def test_a_thread_that_dies_says_why(caplog: pytest.LogCaptureFixture) -> None:
    """A bug ends the thread with a named cause, and the port is given back (promise 10)."""
    worker = VirtualWorker()

    def fault(_: bytes) -> None:
        raise ZeroDivisionError("a bug")

    worker.line.fault = fault
    with caplog.at_level(logging.CRITICAL):
        worker.worker.start()
        assert worker.worker.join(30.0)
    assert worker.worker.failure == "line main: ZeroDivisionError: a bug"
    assert "a bug" in caplog.text
    assert worker.line.closed == 1


# --- the log --------------------------------------------------------------------------------------


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
def test_a_dead_module_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    """One line a transition, not one a miss (docs/failures.md E3)."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2), baud=4800))
    worker.line.modules[1].away = True
    with caplog.at_level(logging.INFO):
        worker.run(100.0 + 200)
    assert [record.getMessage() for record in caplog.records] == [
        "line main: /dev/rs485 is open",
        "line main station 1 (s1): offline: station 1 did not answer",
        "line main station 2 (s2): online: DIO100",
    ]


def test_a_lost_port_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    """However often it is opened in vain; and its return is logged."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.line.at(700.0, lambda: setattr(worker.line, "open_error", None))
    with caplog.at_level(logging.INFO):
        worker.run(710.0)
    assert [record.getMessage() for record in caplog.records] == [
        "line main: /dev/rs485: no such device",
        "line main: /dev/rs485 is open",
        "line main station 1 (s1): online: DIO100",
    ]
    assert all(record.line == "main" for record in caplog.records)  # type: ignore[attr-defined]  # an extra


def test_at_debug_each_exchange_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    """Line, station, what went out, what came back or why not, and how long it took."""
    worker = VirtualWorker(make_line(make_station(1), protocol=LineProtocol.MODBUS_RTU))
    worker.line.at(101.0, lambda: setattr(worker.line.modules[1], "away", True))
    with caplog.at_level(logging.DEBUG, "bridge.line.measured_bus"):
        worker.run(102.0)
    exchanges = [r.getMessage() for r in caplog.records if r.levelno == logging.DEBUG]
    assert len(exchanges) == len(worker.line.wire)
    form = r"line main station 1: 01 [0-9a-f ]+ -> 01 [0-9a-f ]+ \([0-9.]+ ms\)"
    assert re.fullmatch(form, exchanges[0])
    assert "-> station 1 did not answer (" in exchanges[-1]
