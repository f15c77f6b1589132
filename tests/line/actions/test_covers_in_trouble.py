"""Covers whose module, port or bridge fails while they move."""

import logging
import random
from dataclasses import replace
from functools import partial
from itertools import pairwise

import pytest
from support.cover_worker import CLOSE, CLOSE_S, OPEN, OPEN_S, STOP, CoverWorker
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import CoverConfig, OutputConfig
from bridge.model import (
    CoverCommand,
    CoverState,
    LineProtocol,
    Reason,
    Status,
    Writes,
)
from bridge.simulator.faults import is_write

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 102.0
PROTOCOLS = list(LineProtocol)


def test_an_off_that_is_not_obeyed_is_said_again_until_it_is(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Soon, then every few seconds; one line when it fails, one when it is done."""
    worker = CoverWorker()
    worker.ask(T, CLOSE)
    worker.line.at(T + 5, lambda: worker.fault_on_writes(*[Fault.IGNORE] * 6))
    with caplog.at_level(logging.INFO):
        worker.run(T + 20)
    assert worker.module.outputs == 0
    assert len([r for r in caplog.records if "by covers" in r.message]) == 2
    own = [v for v in worker.verdicts() if v.by == "covers"]
    assert [v.status for v in own] == [Status.FAILED, Status.DONE]
    assert worker.orders()[-1][0] - T < CLOSE_S + 5


@pytest.mark.parametrize("fault", [Fault.LOSE_REPLY, Fault.GARBLE_REPLY])
def test_an_on_whose_reply_is_lost_ends_all_the_same(fault: Fault) -> None:
    """It is read back ON, and its time is over when it is over."""
    worker = CoverWorker()
    worker.fault_on_writes(fault)
    worker.ask(T, CLOSE)
    worker.run(T + 13)
    (on_at, *on), (off_at, *off) = worker.orders()
    assert (on, off) == ([2, True], [2, False])
    assert CLOSE_S <= off_at - on_at <= CLOSE_S + 2.0


def test_a_module_that_falls_silent_while_it_moves_is_told_to_stop_when_it_is_back() -> None:
    """Its time was over long ago: OFF is the first thing that it hears after it was met."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.line.at(T + 5, lambda: setattr(worker.module, "away", True))
    worker.line.at(T + 30, lambda: setattr(worker.module, "away", False))
    worker.run(T + 60)
    _, (off_at, *off) = worker.orders()
    assert off == [1, False]
    assert off_at - worker.online_at()[-1][0] < 0.5
    assert worker.shown()[-1] == (CoverState.STOPPED, None)


def test_motors_of_a_silent_module_are_told_to_stop_once_until_it_is_heard() -> None:
    """Four ways end as it falls silent: it is offline within 5 s all the same (promise 7)."""
    outputs = tuple(OutputConfig(n, mode="latch") for n in range(1, 9))
    covers = tuple(CoverConfig(f"c{n}", f"{n}", n, n + 1, 5.0, 5.0) for n in (1, 3, 5, 7))
    groups = tuple(cover.outputs for cover in covers)
    config = replace(make_station(outputs=outputs), covers=covers, interlock=groups)
    worker = VirtualWorker(make_line(config, make_station(2), writes=Writes.WISCO))
    module = worker.line.modules[1]
    worker.line.at(T, lambda: module.write_outputs(0b01010101, 0b01010101, b""))
    worker.line.at(T + 5, lambda: setattr(module, "away", True))
    worker.line.at(T + 20, lambda: setattr(module, "away", False))
    worker.run(T + 40)
    gone, back = (at for at, _ in worker.online_at("s1")[1:])
    assert gone - (T + 5) < 5.0
    assert len([at for at, frame in worker.line.wire if is_write(frame) and at < back]) == 1
    assert module.outputs == 0


def test_a_port_that_goes_in_the_dead_time_leaves_no_command_without_a_verdict() -> None:
    """What waited is refused: nothing goes ON when the port is back."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.ask(T + 5, CLOSE)

    def fault(_: bytes) -> Fault | None:
        return Fault.PORT_GONE if T + 5.3 < worker.line.now < T + 7 else None

    worker.line.fault = fault
    worker.run(T + 20)
    assert worker.verdicts()[-1].reason is Reason.OFFLINE
    assert (2, True) not in worker.moves()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_worker_that_ends_switches_the_motor_off_first(protocol: LineProtocol) -> None:
    """Before the port is closed: nobody would end the movement later (SIGTERM, a reload)."""
    worker = CoverWorker(protocol)
    worker.ask(T, OPEN)
    worker.run(T + 5)
    assert worker.module.outputs == 0
    assert worker.moves() == [(1, True), (1, False)]
    assert worker.states(T)[-1] is CoverState.STOPPED


def test_a_worker_that_ends_in_the_dead_time_refuses_what_waits() -> None:
    """Its verdict says why."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.ask(T + 5, CLOSE)
    worker.run(T + 5.3)
    assert worker.module.outputs == 0
    assert worker.verdicts()[-1].reason is Reason.STOPPING


def test_a_motor_that_cannot_be_stopped_at_the_end_is_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The module does not answer any more: it is tried for a moment, and said aloud."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.line.at(T + 4.5, lambda: setattr(worker.module, "away", True))
    worker.run(T + 5)
    assert worker.line.now - (T + 5) < 4.0
    assert [r.message for r in caplog.records if "may still move" in r.message] != []


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_modules_that_fell_silent_keep_no_other_motor_running_at_the_end(
    protocol: LineProtocol,
) -> None:
    """Three of four are known not to answer: the fourth is told to stop before they are."""
    first = CoverWorker().config.stations[0]
    stations = [replace(first, address=n, id=f"s{n}", name=f"s{n}") for n in (1, 2, 3, 4)]
    worker = VirtualWorker(make_line(*stations, protocol=protocol))
    for config in stations:
        opens = CoverCommand(
            config.id, "cover/shutter", "100", "shutter", 3, OPEN, arrived=T, deadline=T + 2
        )
        worker.line.at(T, partial(worker.worker.submit, opens))

    def fall_silent() -> None:
        for address in (1, 2, 3):
            worker.line.modules[address].away = True

    worker.line.at(T + 5, fall_silent)
    worker.run(T + 6.5)
    stopped = [s.at for s in worker.line.modules[4].switchings if s.frame and not s.value]
    assert [at - (T + 6.5) < 1.0 for at in stopped] == [True]
    assert worker.line.now - (T + 6.5) < 8.0


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("seed", range(4))
def test_whatever_is_lost_never_two_directions_and_never_for_long(
    protocol: LineProtocol, seed: int
) -> None:
    """Random commands on a line that loses a tenth: one verdict each, and the motor ends OFF."""
    chance = random.Random(seed)  # noqa: S311  # cases, not secrets
    worker = CoverWorker(protocol)
    faults = (Fault.LOSE_REQUEST, Fault.LOSE_REPLY, Fault.GARBLE_REPLY)

    def fault(_: bytes) -> Fault | None:
        return chance.choice(faults) if chance.random() < 0.1 else None

    worker.line.fault = fault
    asked = 60
    at = T
    for n in range(asked):
        at += chance.expovariate(0.5)
        worker.ask(at, chance.choice([OPEN, CLOSE, STOP, 30, 70]), f"c{n}")
    worker.run(at + 60)
    worker.check()
    marks = [v.id for v in worker.verdicts() if v.by is None]
    assert sorted(map(str, marks)) == sorted(f"c{n}" for n in range(asked))
    assert worker.module.outputs == 0
    assert _longest_on(worker) < OPEN_S + 10.0
    done = [v for v in worker.verdicts() if v.status is Status.DONE]
    assert len(done) > 20


def _longest_on(worker: CoverWorker) -> float:
    """The longest time that one output was ON in one go."""
    longest = 0.0
    for output in (1, 2):
        turns = [s for s in worker.module.switchings if s.output == output and s.changed]
        for on, off in pairwise(turns):
            if on.value:
                longest = max(longest, off.at - on.at)
    return longest
