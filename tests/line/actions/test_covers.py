"""Covers through the line worker: what goes out, and when, on a virtual clock."""

from dataclasses import replace
from functools import partial

import pytest
from support.cover_worker import CLOSE, CLOSE_S, DEAD_S, DOWN, OPEN, OPEN_S, STOP, UP, CoverWorker
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import CoverConfig, OutputConfig
from bridge.model import (
    CoverChanged,
    CoverCommand,
    CoverState,
    LineProtocol,
    Reason,
    StandingCover,
    StationChanged,
    Status,
    Verdict,
    Writes,
)
from bridge.simulator.faults import is_write

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 102.0
PROTOCOLS = list(LineProtocol)


# --- coming up ------------------------------------------------------------------------------------


def test_it_comes_up_as_stopped_and_nobody_knows_where() -> None:
    """Told before the station is online; nothing is switched."""
    worker = CoverWorker()
    worker.run(T)
    events = worker.reported()
    told = events.index(CoverChanged("s1", "shutter", CoverState.STOPPED, None))
    assert told < events.index(StationChanged("s1", online=True, detail=""))
    assert worker.orders() == []


BUILD = f"1 {OPEN_S}, 2 {CLOSE_S}"


@pytest.mark.parametrize(
    ("left", "position"),
    [
        (StandingCover(1, "s1", "shutter", BUILD, 40.0), 40),
        (StandingCover(2, "s1", "shutter", BUILD, 40.0), None),
        (StandingCover(1, "s2", "shutter", BUILD, 40.0), None),
        (StandingCover(1, "s1", "awning", BUILD, 40.0), None),
        (StandingCover(1, "s1", "shutter", "1 30.0, 2 10.0", 40.0), None),
    ],
)
def test_a_line_goes_on_from_where_the_one_before_left_the_very_cover(
    left: StandingCover, position: int | None
) -> None:
    """Address, station, cover, outputs and times are the same, else the position is not known."""
    worker = CoverWorker()
    worker.worker.inherit((), [left])
    worker.run(T)
    assert worker.shown() == [(CoverState.STOPPED, position)]


def test_a_line_leaves_a_standing_cover_to_the_next() -> None:
    """Driven to its end it is left there; so is one that was stopped for the end of the line."""
    for stopped_at, position in ((T + CLOSE_S + 5, 0.0), (T + 4, None)):
        worker = CoverWorker()
        worker.ask(T, CLOSE)
        worker.run(stopped_at)
        known = [StandingCover(1, "s1", "shutter", BUILD, position)] if position == 0.0 else []
        assert list(worker.worker.standing) == known


def test_a_cover_of_an_absent_module_is_not_left_standing() -> None:
    """While it is away it may move unseen."""
    worker = CoverWorker()
    worker.ask(T, CLOSE)
    worker.line.at(T + CLOSE_S + 5, lambda: setattr(worker.module, "away", True))
    worker.run(T + CLOSE_S + 30)
    assert worker.worker.standing == ()


def test_an_output_that_was_on_at_the_start_goes_off_after_the_whole_time(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """It may have moved ever since: it is said, it is not switched ON, and it ends."""
    worker = CoverWorker()
    worker.module.set_output(2, True)
    worker.run(T + 12)
    ((off_at, *off),) = worker.orders()
    assert off == [2, False]
    assert CLOSE_S + 0.5 <= off_at - 100.0 <= CLOSE_S + 1.5
    assert worker.states() == [CoverState.CLOSING, CoverState.CLOSED]
    assert [r.message for r in caplog.records if "moves unasked" in r.message] != []


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize(
    ("goal", "output", "run_s", "states"),
    [
        (OPEN, 1, OPEN_S + 1.0, [CoverState.OPENING, CoverState.OPEN]),
        (CLOSE, 2, CLOSE_S + 0.5, [CoverState.CLOSING, CoverState.CLOSED]),
    ],
)
def test_it_runs_to_its_end_and_the_motor_goes_off(
    protocol: LineProtocol, goal: int, output: int, run_s: float, states: list[CoverState]
) -> None:
    """One ON, one OFF when the time is over; `done` when it was seen ON; states as they were."""
    worker = CoverWorker(protocol)
    worker.ask(T, goal)
    worker.run(T + run_s + 2)
    (on_at, *on), (off_at, *off) = worker.orders()
    assert (on, off) == ([output, True], [output, False])
    assert run_s <= off_at - on_at <= run_s + 0.3
    assert worker.states(T) == states
    verdict = worker.verdict()
    assert (verdict.target, verdict.status) == ("cover/shutter", Status.DONE)
    assert verdict.ms < 500


def test_the_state_is_told_before_the_verdict_and_the_output_before_both() -> None:
    """docs/contract.md: the new state is published before its verdict."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.run(T + 1)
    kinds = [type(event).__name__ for event in worker.reported(T)]
    assert kinds[:3] == ["ValuesChanged", "CoverChanged", "Verdict"]


def test_what_off_for_an_output_does_to_its_cover_is_told_before_the_verdict() -> None:
    """A cover that stands is told to stand when the OFF that stopped it is `done`."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.command_at(T + 5, UP, 0, command_id="off")
    worker.run(T + 6)
    events = worker.reported(T + 5)
    (verdict,) = (e for e in events if isinstance(e, Verdict) and e.id == "off")
    stood = next(e for e in events if isinstance(e, CoverChanged) and e.state is CoverState.STOPPED)
    assert events.index(stood) < events.index(verdict)


def test_the_position_is_told_once_a_second_while_it_moves() -> None:
    """From a known end; and exactly at the other."""
    worker = CoverWorker()
    worker.ask(T, CLOSE)
    worker.ask(T + 12, OPEN)
    worker.run(T + 35)
    positions = [position for _, position in worker.shown(T + 12)]
    assert 18 <= len(positions) <= 24
    assert positions == sorted(positions, key=lambda p: p or 0)
    assert positions[-1] == 100


def test_stop_switches_off_and_tells_where_it_stands() -> None:
    """`done` when the motor was read OFF."""
    worker = CoverWorker()
    worker.ask(T, CLOSE)
    worker.ask(T + 12, OPEN)
    worker.ask(T + 22, STOP)
    worker.run(T + 24)
    assert worker.moves()[-2:] == [(1, True), (1, False)]
    state, position = worker.shown()[-1]
    assert state is CoverState.STOPPED
    assert position is not None
    assert 48 <= position <= 51
    assert [v.status for v in worker.verdicts()] == [Status.DONE] * 3


def test_stop_at_rest_is_confirmed_too() -> None:
    """OFF is said again: it does no harm, and the verdict is true."""
    worker = CoverWorker()
    worker.ask(T, STOP)
    worker.run(T + 10)
    assert worker.moves() == [(1, False)]
    assert worker.verdict().status is Status.DONE


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_stop_stops_what_a_hand_started_since_the_last_read(protocol: LineProtocol) -> None:
    """`done` says that nothing runs: both outputs, whichever of them ran unknown to us."""
    worker = CoverWorker(protocol)
    running: list[int] = []
    worker.line.at(T, lambda: worker.module.set_output(2, True))
    worker.ask(T + 0.1, STOP)
    worker.line.at(T + 1, lambda: running.append(worker.module.outputs))
    worker.run(T + 2)
    assert running == [0]
    assert worker.verdict().status is Status.DONE


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_reversal_stops_waits_and_goes_the_other_way(protocol: LineProtocol) -> None:
    """OFF, the dead time, ON: one command, one verdict, while the line is read."""
    worker = CoverWorker(protocol)
    worker.ask(T, OPEN)
    worker.ask(T + 5, CLOSE)
    worker.run(T + 18)
    assert worker.moves() == [(1, True), (1, False), (2, True), (2, False)]
    (_, *_), (off_at, *_), (on_at, *_), _ = worker.orders()
    assert DEAD_S <= on_at - off_at <= DEAD_S + 0.3
    assert len([at for at, _ in worker.line.wire if off_at + 0.1 < at < on_at]) > 5
    first, second = worker.verdicts()
    assert (first.status, second.status) == (Status.DONE, Status.DONE)
    assert second.ms >= 500
    worker.check()


def test_a_direction_right_after_a_stop_waits_for_the_dead_time_by_itself() -> None:
    """Nobody has to send it again."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.ask(T + 5, STOP)
    worker.ask(T + 5.2, CLOSE)
    worker.run(T + 18)
    assert worker.moves() == [(1, True), (1, False), (2, True), (2, False)]
    worker.check()


def test_a_reversal_that_would_be_late_is_refused_before_anything_is_sent() -> None:
    """Nothing goes out after the deadline (promise 2), and half of a reversal is none."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.ask(T + 5, CLOSE, deadline_s=0.3)
    worker.run(T + 23)
    assert worker.states(T) == [CoverState.OPENING, CoverState.OPEN]
    assert worker.verdicts()[-1].reason is Reason.EXPIRED


def test_stop_in_the_dead_time_overrules_what_waits() -> None:
    """The direction that waited never goes ON; both commands have their verdict."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.ask(T + 5, CLOSE, "a")
    worker.ask(T + 5.3, STOP, "b")
    worker.run(T + 10)
    assert (2, True) not in worker.moves()
    _, waited, stopped = worker.verdicts()
    assert (waited.id, waited.reason) == ("a", Reason.SUPERSEDED)
    assert (stopped.id, stopped.status) == ("b", Status.DONE)


def test_what_waits_while_the_module_obeys_nobody_expires() -> None:
    """Somebody switches both ON, and OFF fails: that keeps no command beyond its deadline."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.ask(T + 5, CLOSE, "a")

    def both() -> None:
        worker.module.set_output(1, True)
        worker.module.set_output(2, True)
        worker.line.fault = lambda frame: Fault.IGNORE if is_write(frame) else None

    worker.line.at(T + 5.2, both)
    worker.command_at(T + 5.3, 0b1000_0000, 0)  # its read finds both ON
    worker.run(T + 12)
    (waited,) = (verdict for verdict in worker.verdicts() if verdict.id == "a")
    assert waited.reason is Reason.EXPIRED
    assert waited.ms < 3000


def test_what_waits_expires_in_time_while_other_motors_cannot_be_stopped() -> None:
    """Three ways end as the module falls silent, and each OFF takes 2 s: one verdict in time."""
    outputs = tuple(OutputConfig(n, mode="latch") for n in range(1, 9))
    covers = tuple(CoverConfig(f"c{n}", f"{n}", n, n + 1, 5.0, 5.0) for n in (1, 3, 5, 7))
    groups = tuple(cover.outputs for cover in covers)
    config = replace(make_station(outputs=outputs), covers=covers, interlock=groups)
    worker = VirtualWorker(make_line(config, baud=4800, writes=Writes.WISCO))
    for goal, at in ((OPEN, T), (CLOSE, T + 5.2)):
        moves = CoverCommand(
            "s1", "cover/c7", str(goal), "c7", 0b11 << 6, goal, arrived=at, deadline=at + 2, id=goal
        )
        worker.line.at(at, partial(worker.worker.submit, moves))
    worker.line.at(T, lambda: worker.line.modules[1].write_outputs(0b010101, 0b010101, b""))
    worker.line.at(T + 5.5, lambda: setattr(worker.line.modules[1], "away", True))
    worker.run(T + 20)
    (waited,) = (verdict for verdict in worker.verdicts() if verdict.id == CLOSE)
    assert waited.reason is Reason.EXPIRED
    assert waited.ms < 2000 + 2200


def test_off_for_an_output_overrules_what_waits() -> None:
    """All outputs OFF means that nothing moves a moment later."""
    worker = CoverWorker()
    worker.ask(T, OPEN)
    worker.ask(T + 5, CLOSE, "a")
    worker.command_at(T + 5.3, 0xFF, 0)
    worker.run(T + 10)
    assert (2, True) not in worker.moves()
    assert [v.reason for v in worker.verdicts()] == [None, Reason.SUPERSEDED, None]


def test_commands_that_wait_for_the_line_are_superseded_by_the_last() -> None:
    """A slider that is drawn sends many positions."""
    worker = CoverWorker()
    worker.ask(T, CLOSE)
    for n in range(10):
        worker.ask(T + 12, 50 + n, f"p{n}")
    worker.run(T + 26)
    verdicts = worker.verdicts()[1:]
    assert [v.reason for v in verdicts[:-1]] == [Reason.SUPERSEDED] * 9
    assert (verdicts[-1].id, verdicts[-1].status) == ("p9", Status.DONE)
    assert worker.moves() == [(2, True), (2, False), (1, True), (1, False)]


def test_a_position_is_reached_from_both_sides() -> None:
    """By time, from a known end; each movement ends with the motor OFF."""
    worker = CoverWorker()
    worker.ask(T, CLOSE)
    worker.ask(T + 12, 60)
    worker.ask(T + 26, 25)
    worker.run(T + 32)
    rests = [position for state, position in worker.shown() if state is CoverState.STOPPED]
    _, high, low = rests
    assert high is not None
    assert low is not None
    assert 59 <= high <= 62
    assert 23 <= low <= 26
    assert [v.status for v in worker.verdicts()] == [Status.DONE] * 3


def test_a_position_that_it_has_moves_nothing() -> None:
    """OFF is confirmed, and that is all."""
    worker = CoverWorker()
    worker.ask(T, CLOSE)
    worker.ask(T + 12, 50)
    worker.line.at(T + 24, lambda: worker.ask(T + 24, worker.shown()[-1][1]))
    worker.run(T + 26)
    assert worker.moves() == [(2, True), (2, False), (1, True), (1, False), (1, False)]
    assert worker.verdicts()[-1].status is Status.DONE


def test_an_end_is_driven_to_again() -> None:
    """Whoever says CLOSE to a cover that is closed may see that it is not."""
    worker = CoverWorker()
    worker.ask(T, CLOSE)
    worker.ask(T + 12, CLOSE)
    worker.run(T + 24)
    assert worker.moves() == [(2, True), (2, False)] * 2


def test_a_position_is_refused_while_nobody_knows_where_it_is() -> None:
    """It would be a guess: OPEN or CLOSE comes first."""
    worker = CoverWorker()
    worker.ask(T, 50)
    worker.run(T + 10)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason) == (Status.REFUSED, Reason.BUSY)
    assert verdict.detail is not None
    assert "OPEN or CLOSE" in verdict.detail
    assert worker.orders() == []


def test_a_module_that_is_away_takes_no_command() -> None:
    """At once, also for what waits for its dead time."""
    worker = CoverWorker()
    worker.line.at(T, lambda: setattr(worker.module, "away", True))
    worker.ask(T + 10, OPEN)
    worker.run(T + 20)
    assert worker.verdict().reason is Reason.OFFLINE


# --- what others do -------------------------------------------------------------------------------


def test_what_a_hand_moves_ends_too() -> None:
    """After the whole time; the position is known at the end."""
    worker = CoverWorker()
    worker.line.at(T, lambda: worker.module.set_output(1, True))
    worker.run(T + 25)
    ((off_at, *off),) = worker.orders()
    assert off == [1, False]
    assert OPEN_S + 1.0 <= off_at - T <= OPEN_S + 1.0 + 2.5  # and a sweep of the outputs
    assert worker.shown()[-1] == (CoverState.OPEN, 100)


@pytest.mark.parametrize("lost", [[], [Fault.PORT_GONE_AFTER]], ids=["", "port gone"])
def test_both_directions_on_are_switched_off_at_once(lost: list[Fault]) -> None:
    """Another master did that: a motor that gets both burns. A port that fails is opened anew."""
    worker, faults = CoverWorker(), list(lost)
    worker.line.at(T, lambda: worker.module.write_outputs(UP | DOWN, UP | DOWN, b""))
    worker.line.fault = lambda frame: faults.pop() if faults and is_write(frame) else None
    worker.run(T + 10)
    assert set(worker.moves()) == {(1, False), (2, False)}
    assert lost or len(worker.moves()) == 2
    assert worker.module.outputs == 0
    assert len(worker.line.opened) == 1 + len(lost)
    assert lost or worker.orders()[-1][0] - T < 3.0


def test_over_wisco_frames_alone_a_motor_has_to_be_seen_running() -> None:
    """Its mode cannot be read, so ON is sent once; `done` takes a read that finds it ON."""
    worker = CoverWorker(writes=Writes.WISCO)
    worker.fault_on_writes(Fault.IGNORE)
    worker.ask(T, OPEN)
    worker.ask(T + 5, OPEN)
    worker.run(T + 28)
    failed, done = worker.verdicts()
    assert (failed.status, failed.reason) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert (done.status, done.seen_on) == (Status.DONE, True)
    assert worker.moves() == [(1, True), (1, False)]
    assert worker.shown()[-1] == (CoverState.OPEN, 100)
