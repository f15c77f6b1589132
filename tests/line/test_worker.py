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


# --- commands -------------------------------------------------------------------------------------


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
