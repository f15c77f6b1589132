import random
from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.virtual_plan import Costs, VirtualPlan, line_of

from bridge.config.schema import LineConfig
from bridge.line.plan.plan import Idle, WirePlan
from bridge.line.plan.streams import Poll, polls_of, streams_of
from bridge.line.rules.presence import Kind, Presence
from bridge.model import DIO100, DO100, LineProtocol

COSTS = Costs.of(LineProtocol.WISCO, 9600)


def equal_line(count: int) -> LineConfig:
    """DIO100s whose outputs are read as often as their inputs."""
    return line_of(DIO100, count, output_sweep_s=0.0)


def make_plan(*online: bool) -> tuple[WirePlan, dict[int, Presence]]:
    """A plan of DIO100s, of which some are online."""
    presences = {address: Presence() for address in range(len(online))}
    for address, is_online in enumerate(online):
        if is_online:
            presences[address].arrived(0.0)
    return WirePlan(streams_of(equal_line(len(online))), presences), presences


def test_polls_are_inputs_and_outputs_in_the_order_of_the_file() -> None:
    """A DO100 has outputs alone."""
    assert polls_of(line_of(DIO100, 1)) == (Poll(0, Kind.INPUTS), Poll(0, Kind.OUTPUTS))
    assert polls_of(line_of(DO100, 2)) == (Poll(0, Kind.OUTPUTS), Poll(1, Kind.OUTPUTS))


def test_a_read_to_be_repeated_comes_before_all_others() -> None:
    """A change is confirmed at once, and the round goes on where it was."""
    plan, _ = make_plan(True, True)
    first = plan.next(1.0)
    assert isinstance(first, Poll)
    plan.again(first)
    assert plan.next(1.0) == first
    assert plan.next(1.0) == Poll(0, Kind.OUTPUTS)


def test_channels_that_change_at_every_read_do_not_hold_up_the_line() -> None:
    """A read is repeated once; then the round goes on, whatever it said."""
    plan, _ = make_plan(True, True)
    read = Counter[Poll]()
    for _ in range(60):
        due = plan.next(1.0)
        assert isinstance(due, Poll)
        read[due] += 1
        if due == Poll(0, Kind.INPUTS):
            plan.again(due)
    assert read[Poll(0, Kind.INPUTS)] == 24
    assert min(read.values()) == 12


def test_a_repeat_is_dropped_when_its_module_went_away() -> None:
    """After a module went offline only a contact is read there: its repeat is dropped."""
    plan, presences = make_plan(True, True)
    due = plan.next(1.0)
    assert isinstance(due, Poll)
    plan.again(due)
    presences[0].lost(1.0)
    assert plan.next(1.0) == Poll(1, Kind.INPUTS)
    assert plan.next(1.0) == Poll(0, Kind.CONTACT)


def test_a_missed_read_waits_for_its_time_and_the_module_is_left_alone_until_then() -> None:
    """After a miss the module is not read for 0.25 s; then the missed read is repeated."""
    plan, presences = make_plan(True, True)
    assert plan.next(1.0) == Poll(0, Kind.INPUTS)
    presences[0].missed(Kind.INPUTS, 1.0)
    assert {plan.next(1.1) for _ in range(10)} == {Poll(1, Kind.INPUTS), Poll(1, Kind.OUTPUTS)}
    assert plan.next(1.25) == Poll(0, Kind.INPUTS)
    presences[0].answered(1.25)
    assert Poll(0, Kind.OUTPUTS) in {plan.next(1.25), plan.next(1.25)}


def test_of_several_due_tries_the_longest_overdue_comes_first() -> None:
    """By turns with a healthy read."""
    plan, presences = make_plan(True, True, True)
    presences[1].missed(Kind.OUTPUTS, 1.0)
    presences[0].missed(Kind.INPUTS, 1.1)
    assert plan.next(2.0) == Poll(1, Kind.OUTPUTS)
    presences[1].missed(Kind.OUTPUTS, 2.0)
    assert plan.next(2.0) == Poll(2, Kind.INPUTS)
    assert plan.next(2.0) == Poll(0, Kind.INPUTS)


def test_without_healthy_modules_it_sleeps_until_the_next_try_or_probe() -> None:
    """No module is asked before its time, and the sleep ends at the first."""
    plan, presences = make_plan(True, False)
    presences[0].missed(Kind.INPUTS, 1.0)
    assert plan.next(1.0) == Poll(1, Kind.CONTACT)
    presences[1].absent(1.0)
    assert plan.next(1.1) == Idle(1.25)
    assert plan.next(1.25) == Poll(0, Kind.INPUTS)
    presences[0].missed(Kind.INPUTS, 1.4)
    assert plan.next(1.4) == Idle(1.5)


def test_modules_that_answer_come_online_without_waiting_for_a_round_each() -> None:
    """Contacts and healthy reads by turns: 32 modules are up within some 65 exchanges."""
    plan = VirtualPlan(line_of(DIO100, 32), COSTS, lambda *_: True)
    while not plan.all_online():
        plan.step()
    contacts = [poll for _, poll, _ in plan.asked if poll.kind is Kind.CONTACT]
    assert len(contacts) == 32
    assert len(plan.asked) <= 65
    kinds = [poll.kind for _, poll, _ in plan.asked]
    assert (Kind.CONTACT, Kind.CONTACT) not in pairwise(kinds)


def test_one_dead_module_is_probed_in_vain_a_round() -> None:
    """Of many dead modules one is probed in a cycle (docs/contract.md, promise 7)."""
    plan = VirtualPlan(line_of(DIO100, 10), COSTS, lambda address, _: address >= 5)
    plan.run_until(20.0)
    reads_between, count = [], 0
    for _, poll, answered in plan.asked[40:]:
        if poll.kind is Kind.CONTACT:
            assert not answered
            reads_between.append(count)
            count = 0
        else:
            count += 1
    assert len(reads_between) > 3
    assert min(reads_between[1:]) >= 10


def test_an_urgent_probe_waits_for_no_round_and_healthy_reads_go_between() -> None:
    """Something is due at a module that is gone: the others have every other read."""
    plan, presences = make_plan(True, True, False)
    plan.next(1.0)
    presences[2].absent(1.0)
    presences[2].absent(1.0)
    assert plan.next(1.1) != Poll(2, Kind.CONTACT)
    presences[2].hasten(1.1)
    assert plan.next(1.1) == Poll(2, Kind.CONTACT)
    healthy = plan.next(1.1)
    assert isinstance(healthy, Poll)
    assert healthy.address != 2
    presences[2].absent(1.2)
    assert all(plan.next(1.2 + n / 100) != Poll(2, Kind.CONTACT) for n in range(50))


def test_after_a_probe_in_vain_probes_rest_for_nine_times_as_long() -> None:
    """So they take a tenth of the line; a module that was never asked does not wait for that."""
    plan, presences = make_plan(True, False, False, False)
    for address in (1, 2):
        presences[address].absent(0.0)
    plan.probed_in_vain(0.4, 1.0)

    def probed(since: float, until: float) -> list[int]:
        asked = [plan.next(since + n * (until - since) / 50) for n in range(50)]
        polls = [poll for poll in asked if isinstance(poll, Poll)]
        return [poll.address for poll in polls if poll.kind is Kind.CONTACT]

    assert set(probed(1.0, 2.0)) == {3}
    presences[3].arrived(2.0)
    assert probed(2.0, 4.5) == []
    assert set(probed(4.61, 5.0)) == {1}


def test_a_long_contact_in_vain_delays_other_probes_by_10_s_at_most() -> None:
    """A module that answers in part can make it last for seconds: others may be back meanwhile."""
    plan, presences = make_plan(True, False)
    presences[1].absent(0.0)
    plan.probed_in_vain(5.0, 1.0)
    plan.next(1.0)
    polls = [plan.next(11.0 + n / 100) for n in range(10)]
    assert Poll(1, Kind.CONTACT) in polls


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
@settings(max_examples=40)
@given(
    count=st.integers(1, 12),
    dead=st.sets(st.integers(0, 11)),
    loss=st.sampled_from([0.0, 0.05, 0.3]),
    seed=st.integers(0, 2**32),
)
def test_nobody_starves(count: int, dead: set[int], loss: float, seed: int) -> None:
    """Every module gets its turn, whichever modules are dead.

    After a failed read comes one of a healthy module, if there is one. A healthy read is never
    repeated before all other healthy ones were made. Every dead module is probed.
    """
    dice = random.Random(seed)  # noqa: S311  # losses, no secrets
    plan = VirtualPlan(
        equal_line(count),
        COSTS,
        lambda address, _: address not in dead and dice.random() >= loss,
    )
    in_vain = False
    since: dict[Poll, int] = {}
    while plan.now < 30.0:
        healthy = {s for s, p in plan.presences.items() if p.online and p.suspect is None}
        made = len(plan.asked)
        plan.step()
        if len(plan.asked) == made:
            assert not healthy
            continue
        _, poll, answered = plan.asked[-1]
        if in_vain and healthy:
            assert poll.address in healthy
        in_vain = not answered
        if poll.address in healthy and poll.kind is not Kind.CONTACT:
            since.pop(poll, None)
            for other in polls_of(plan.line):
                if other.address in healthy and other != poll:
                    since[other] = since.get(other, 0) + 1
        since = {p: n for p, n in since.items() if p.address in healthy}
        assert all(n <= 2 * count * 2 for n in since.values())
    probed = {poll.address for _, poll, _ in plan.asked if poll.kind is Kind.CONTACT}
    assert probed == set(range(count))
