"""The plan spends the wire on what can have changed, and keeps to the bounds that it states."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.virtual_plan import Costs, VirtualPlan, line_of

from bridge.config.schema import LineConfig, StationConfig
from bridge.line.plan.bounds import bound_s, cycle_s
from bridge.line.plan.streams import Poll, polls_of, streams_of
from bridge.line.rules.presence import Kind
from bridge.model import DIO100, DO100, LineProtocol

COSTS = Costs.of(LineProtocol.MODBUS_RTU, 57600)


def mixed_line(models: str, sweep_s: float = 2.0) -> LineConfig:
    """A letter a station: d a DIO100, o a DO100, in capitals those of high priority."""
    stations = tuple(
        StationConfig(
            address,
            DIO100 if letter in "dD" else DO100,
            f"s{address}",
            f"s{address}",
            (),
            (),
            high_priority=letter.isupper(),
        )
        for address, letter in enumerate(models)
    )
    return replace(line_of(DIO100, 1, sweep_s), stations=stations)


def running(line: LineConfig, costs: Costs = COSTS) -> VirtualPlan:
    """A plan of modules that all answer, from soon after they all came online."""
    plan = VirtualPlan(line, costs, lambda *_: True)
    while not plan.all_online():
        plan.step()
    plan.run_until(plan.now + 300 * costs.good_s)
    plan.asked.clear()
    plan.reads.clear()
    return plan


def gaps_s(plan: VirtualPlan, poll: Poll) -> list[float]:
    """The times between the reads of one poll."""
    return [later - earlier for earlier, later in pairwise(plan.reads[poll])]


def asked(plan: VirtualPlan) -> list[Poll]:
    """Return the reads, in order."""
    return [poll for _, poll, _ in plan.asked]


# --- what is read how often --------------------------------------------------------------------


def test_inputs_are_read_all_the_time_and_outputs_once_in_a_sweep() -> None:
    """31 modules: seven rounds of inputs go by while each output is read once."""
    plan = running(line_of(DIO100, 31))
    plan.run_until(plan.now + 60)
    inputs = [g for s in range(31) for g in gaps_s(plan, Poll(s, Kind.INPUTS))]
    outputs = [g for s in range(31) for g in gaps_s(plan, Poll(s, Kind.OUTPUTS))]
    assert max(outputs) <= 2.0
    assert sum(outputs) / len(outputs) == pytest.approx(1.9, rel=0.02)
    share = 31 * COSTS.good_s / 1.9
    assert sum(inputs) / len(inputs) == pytest.approx(31 * COSTS.good_s / (1 - share), rel=0.02)


def test_sweeps_come_one_by_one() -> None:
    """Never two in a row: a change of an input waits for one of them at the most."""
    plan = running(line_of(DIO100, 31))
    plan.run_until(plan.now + 10)
    kinds = [poll.kind for poll in asked(plan)]
    assert (Kind.OUTPUTS, Kind.OUTPUTS) not in pairwise(kinds)


def test_a_line_too_slow_for_the_sweep_reads_both_by_turns() -> None:
    """Inputs are never left for outputs: every other read is of inputs."""
    costs = Costs.of(LineProtocol.MODBUS_ASCII, 4800)
    plan = running(line_of(DIO100, 31), costs)
    plan.run_until(plan.now + 60)
    counts = Counter(poll.kind for poll in asked(plan))
    assert counts[Kind.INPUTS] == pytest.approx(counts[Kind.OUTPUTS], abs=2)


def test_a_line_without_inputs_reads_its_outputs_all_the_time() -> None:
    """On a line without inputs the outputs are read all the time."""
    plan = running(line_of(DO100, 4))
    plan.run_until(plan.now + 5)
    assert max(gaps_s(plan, Poll(2, Kind.OUTPUTS))) == pytest.approx(4 * COSTS.good_s)


def test_outputs_are_read_all_the_time_when_nobody_with_inputs_answers() -> None:
    """Without an answering module with inputs, the outputs are read all the time."""
    plan = running(mixed_line("doo"))
    plan.presences[0].lost(plan.now)
    plan.presences[0].probe_at = plan.now + 1000
    plan.run_until(plan.now + 1)
    assert max(gaps_s(plan, Poll(1, Kind.OUTPUTS))) == pytest.approx(2 * COSTS.good_s)


def test_outputs_that_were_read_ahead_of_time_are_swept_in_time_again_afterwards() -> None:
    """A sweep that ran ahead of its time returns to its time when inputs are back."""
    plan = running(mixed_line("do"))
    dead_from, dead_until = plan.now, plan.now + 30
    plan.answers = lambda address, now: address == 1 or not dead_from <= now < dead_until
    plan.run_until(dead_until)
    while not plan.all_online():
        plan.step()
    back = plan.now
    plan.run_until(back + 20)
    for address in (0, 1):
        reads = [at for at in plan.reads[Poll(address, Kind.OUTPUTS)] if at > back]
        assert max(later - earlier for earlier, later in pairwise([back, *reads])) <= 2.0


def test_a_sweep_of_0_s_reads_everything_equally_often() -> None:
    """Inputs and outputs in the order of the file: the plain cycle."""
    line = mixed_line("dod", sweep_s=0.0)
    plan = running(line)
    plan.run_until(plan.now + 1)
    order = asked(plan)
    assert Counter(order[: 5 * 4]) == Counter(dict.fromkeys(polls_of(line), 4))
    assert order[5:10] == order[:5]


# --- what is wanted sooner ---------------------------------------------------------------------


def test_a_station_of_high_priority_is_read_four_times_as_often() -> None:
    """A station of high priority is read four times as often, and the others are still read."""
    plan = running(mixed_line("D" + "d" * 15))
    plan.run_until(plan.now + 20)
    counts = Counter(poll for poll in asked(plan) if poll.kind is Kind.INPUTS)
    normal = [counts[Poll(s, Kind.INPUTS)] for s in range(1, 16)]
    assert max(normal) - min(normal) <= 1
    assert counts[Poll(0, Kind.INPUTS)] == pytest.approx(3.75 * normal[0], rel=0.02)


def test_a_do100_of_high_priority_is_not_left_to_the_sweep() -> None:
    """A DO100 of high priority has only outputs, and these are read often."""
    plan = running(mixed_line("Odddd"))
    plan.run_until(plan.now + 5)
    assert max(gaps_s(plan, Poll(0, Kind.OUTPUTS))) < 8 * COSTS.good_s


def test_a_station_that_changed_is_read_again_soon() -> None:
    """After 12 other reads; the others wait for that one only."""
    plan = running(line_of(DIO100, 31))
    plan.run_until(plan.now + 2)
    changed = asked(plan)[-1] if plan.asked[-1][1].kind is Kind.INPUTS else asked(plan)[-2]
    begun = len(plan.asked)
    plan.plan.changed(changed)
    plan.run_until(plan.now + 1)
    order = [poll for poll in asked(plan)[begun:] if poll.kind is Kind.INPUTS]
    assert order.index(changed) in {11, 12}
    assert len(set(order[:32])) == 31


def test_stations_that_change_at_every_read_starve_nobody() -> None:
    """Stations that change at every read get one read in 13 out of turn."""
    plan = running(line_of(DIO100, 31))
    for _ in range(2000):
        plan.step()
        if plan.asked[-1][1].address < 12:
            plan.plan.changed(plan.asked[-1][1])
    for address in range(12, 31):
        gaps = gaps_s(plan, Poll(address, Kind.INPUTS))
        poll = Poll(address, Kind.INPUTS)
        assert max(gaps) <= bound_s(streams_of(plan.line), poll, lambda _: COSTS.good_s)


def test_an_appointment_is_kept() -> None:
    """The outputs of a module are read when its pulse is over, not a sweep later."""
    plan = running(line_of(DIO100, 31))
    plan.run_until(plan.now + 1)
    outputs = Poll(7, Kind.OUTPUTS)
    at = plan.now + 0.5
    plan.plan.appoint(outputs, at)
    plan.run_until(plan.now + 1)
    kept = [when for when, poll, _ in plan.asked if poll == outputs and when >= at]
    assert kept[0] - at <= 0.05 + 3 * COSTS.good_s


def test_appointments_with_those_who_left_are_dropped() -> None:
    """Appointments with an offline module are dropped."""
    plan = running(line_of(DIO100, 3))
    plan.plan.appoint(Poll(1, Kind.OUTPUTS), plan.now + 0.1)
    plan.presences[1].lost(plan.now)
    plan.presences[1].probe_at = plan.now + 1000
    plan.run_until(plan.now + 1)
    assert Poll(1, Kind.OUTPUTS) not in asked(plan)


def test_stations_that_have_to_wait_are_read_first_when_they_may() -> None:
    """Meanwhile the others are read; their turn and their appointments are kept."""
    plan = running(line_of(DIO100, 8)).plan
    plan.appoint(Poll(1, Kind.OUTPUTS), 100.0)
    meanwhile = [plan.next(100.1 + n / 100, {0, 1}) for n in range(30)]
    values = {Kind.INPUTS, Kind.OUTPUTS}
    read = [poll for poll in meanwhile if isinstance(poll, Poll) and poll.kind in values]
    assert {poll.address for poll in read} == set(range(2, 8))
    then = [plan.next(100.4 + n / 100) for n in range(8)]
    assert {Poll(0, Kind.INPUTS), Poll(1, Kind.INPUTS), Poll(1, Kind.OUTPUTS)} <= set(then)


def test_where_all_have_to_wait_the_next_is_what_it_would_be() -> None:
    """The line then waits for its turn to be asked."""
    one, other = (running(line_of(DIO100, 4)).plan for _ in range(2))
    assert [one.next(100.0, {0, 1, 2, 3}) for _ in range(9)] == [
        other.next(100.0) for _ in range(9)
    ]


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
def test_a_flood_of_appointments_holds_up_no_inputs() -> None:
    """With many ends of pulses every other read is of inputs; equal appointments are merged."""
    plan = running(line_of(DIO100, 31))
    for n in range(5000):
        plan.plan.appoint(Poll(n % 31, Kind.OUTPUTS), plan.now + n / 2500)
    begun = len(plan.asked)
    plan.run_until(plan.now + 2)
    kinds = [poll.kind for poll in asked(plan)[begun:]]
    assert (Kind.OUTPUTS, Kind.OUTPUTS) not in pairwise(kinds)


# --- the bounds ---------------------------------------------------------------------------------


@settings(max_examples=60)
@given(
    models=st.text("doDO", min_size=1, max_size=32),
    sweep_s=st.sampled_from([0.0, 0.5, 2.0, 10.0]),
    costs=st.sampled_from([COSTS, Costs.of(LineProtocol.MODBUS_ASCII, 4800)]),
    changing=st.sets(st.integers(0, 31)),
)
def test_no_channel_is_unread_for_longer_than_the_bound(
    models: str, sweep_s: float, costs: Costs, changing: set[int]
) -> None:
    """The bound that `check` prints holds on the clock, for any line."""
    line = mixed_line(models, sweep_s)
    plan = running(line, costs)
    until = plan.now + 3 * max(sweep_s, 150 * costs.good_s)
    while plan.now < until:
        plan.step()
        if plan.asked[-1][1].address in changing and plan.asked[-1][1].kind is Kind.INPUTS:
            plan.plan.changed(plan.asked[-1][1])
    for poll in polls_of(line):
        bound = bound_s(streams_of(line), poll, lambda _: costs.good_s)
        assert max(gaps_s(plan, poll)) + costs.good_s <= bound + 1e-9


def test_a_round_takes_no_longer_than_the_cycle() -> None:
    """While nothing changes, and but for one read of settings in between."""
    line = line_of(DIO100, 20)
    plan = running(line)
    plan.run_until(plan.now + 10)
    cycle = cycle_s(streams_of(line), lambda _: COSTS.good_s)
    for address in range(20):
        assert max(gaps_s(plan, Poll(address, Kind.INPUTS))) <= cycle + COSTS.good_s + 1e-9
