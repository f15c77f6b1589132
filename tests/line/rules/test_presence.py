import random

import pytest
from support.virtual_plan import Costs, VirtualPlan, line_of

from bridge.line.plan.streams import Poll
from bridge.line.rules.presence import URGENT_PROBE_S, Kind, Presence, UrgentProbes, fallen_silent
from bridge.model import DIO100, DO100, LineProtocol, ModuleType

NEVER = 1e9
NEVER_DUE = float("inf")
LINES = [
    (LineProtocol.WISCO, 4800, 32),
    (LineProtocol.WISCO, 9600, 1),
    (LineProtocol.WISCO, 57600, 5),
    (LineProtocol.MODBUS_RTU, 9600, 32),
    (LineProtocol.MODBUS_RTU, 57600, 8),
    (LineProtocol.MODBUS_ASCII, 9600, 32),
    (LineProtocol.MODBUS_ASCII, 4800, 2),
]


class House:
    """A simulated line whose modules can die."""

    def __init__(
        self,
        protocol: LineProtocol,
        baud: int,
        count: int,
        module: ModuleType = DIO100,
        output_sweep_s: float = 2.0,
    ) -> None:
        self.dies_at: dict[int, float] = {}
        self.costs = Costs.of(protocol, baud)
        self.plan = VirtualPlan(line_of(module, count, output_sweep_s), self.costs, self._answers)

    def _answers(self, address: int, now: float) -> bool:
        return now < self.dies_at.get(address, NEVER)

    def settle(self) -> float:
        """Runs until all are online and a few rounds more; returns the instant."""
        while not self.plan.all_online():
            self.plan.step()
        self.plan.run_until(self.plan.now + 8)
        return self.plan.now


def online_presence(now: float = 0.0) -> Presence:
    """A module that was just met."""
    presence = Presence()
    presence.arrived(now)
    return presence


def test_eight_misses_in_less_than_two_seconds_are_not_enough() -> None:
    """Eight misses in less than 2 s do not take a module offline."""
    presence = online_presence()
    for n in range(50):
        now = 1.0 + n * 0.039
        presence.missed(Kind.INPUTS, now)
        assert fallen_silent({1: presence}, now) == []


def test_two_silent_seconds_with_seven_misses_are_not_enough() -> None:
    """Eight misses are what it takes where the module was heard lately."""
    presence = online_presence(now=1.0)
    for n in range(7):
        presence.missed(Kind.INPUTS, 1.0 + n * 0.42)
    assert fallen_silent({1: presence}, 3.6) == []
    presence.missed(Kind.INPUTS, 3.7)
    assert fallen_silent({1: presence}, 3.7) == [1]


def test_an_answer_begins_the_count_anew() -> None:
    """Misses count in a row only."""
    presence = online_presence()
    for n in range(7):
        presence.missed(Kind.INPUTS, 1.0 + n * 0.25)
    presence.answered(2.9)
    assert presence.suspect is None
    assert presence.silent_s(9.0) == 0.0
    presence.missed(Kind.OUTPUTS, 3.5)
    assert fallen_silent({1: presence}, 3.5) == []
    assert presence.suspect is Kind.OUTPUTS


def test_misses_of_several_silent_modules_are_counted_together() -> None:
    """Four modules silent for 2 s with two misses each are gone; one that was heard is not."""
    presences = {n: online_presence() for n in range(5)}
    for n in range(4):
        presences[n].missed(Kind.INPUTS, 1.0)
        presences[n].missed(Kind.INPUTS, 3.0)
    presences[4].answered(2.0)
    assert fallen_silent(presences, 2.99) == []
    assert fallen_silent(presences, 3.0) == [0, 1, 2, 3]


def test_a_module_that_missed_only_just_now_is_not_gone_with_the_silent_ones() -> None:
    """A module that missed a moment ago stays online when the silent ones go offline."""
    presences = {n: online_presence() for n in range(3)}
    for _ in range(8):
        presences[0].missed(Kind.INPUTS, 1.0)
    presences[2].answered(2.0)
    presences[1].missed(Kind.INPUTS, 2.5)
    assert fallen_silent(presences, 3.0) == [0]


def test_where_nobody_answers_everybody_is_gone() -> None:
    """A cut line is offline as a whole: those not asked yet go too, and are asked first then."""
    presences = {n: online_presence() for n in range(3)}
    for n in range(8):
        presences[n % 2].missed(Kind.INPUTS, 1.0 + n * 0.43)
    now = 1.0 + 7 * 0.43
    assert fallen_silent(presences, now) == [0, 1, 2]
    for presence in presences.values():
        presence.gone(now)
    assert presences[2].probe_at == now
    assert presences[0].probe_at == now + 0.5


def test_probes_come_ever_more_rarely() -> None:
    """A dead module is asked after 0.5, 1, 2, 4, 8, 16 and then every 30 s."""
    presence = online_presence()
    presence.missed(Kind.INPUTS, 10.0)
    presence.gone(10.0)
    now, pauses = 10.0, []
    for _ in range(9):
        pauses.append(presence.probe_at - now)
        now = presence.probe_at
        presence.absent(now)
    assert pauses == [0.5, 1, 2, 4, 8, 16, 30, 30, 30]


def test_a_module_that_came_back_is_probed_soon_when_it_goes_again() -> None:
    """Coming online, or losing the port, sets the pause between probes back."""
    presence = Presence()
    for _ in range(9):
        presence.absent(0.0)
    presence.arrived(100.0)
    presence.missed(Kind.INPUTS, 101.0)
    presence.gone(101.0)
    assert presence.probe_at == 101.5
    presence.lost(200.0)
    assert (presence.probe_at, presence.online, presence.suspect) == (200.0, False, None)
    presence.absent(200.0)
    assert presence.probe_at == 200.5


@pytest.mark.parametrize(("protocol", "baud", "count"), LINES)
def test_a_dead_module_is_offline_within_five_seconds(
    protocol: LineProtocol, baud: int, count: int
) -> None:
    """Whenever in the round it dies, whatever the line: docs/failures.md C6."""
    for part in range(6):
        house = House(protocol, baud, count)
        dead_at = house.settle() + part * count * house.costs.good_s / 3
        house.dies_at[0] = dead_at
        house.plan.run_until(dead_at + 12)
        (offline_at,) = house.plan.flips.pop(0)
        assert 2.0 <= offline_at - dead_at <= 5.0
        assert not house.plan.flips


@pytest.mark.parametrize(("protocol", "baud", "count"), LINES)
def test_a_cut_line_is_offline_within_five_seconds(
    protocol: LineProtocol, baud: int, count: int
) -> None:
    """All modules at once, 32 of them too: docs/contract.md, promise 7."""
    house = House(protocol, baud, count)
    dead_at = house.settle()
    house.dies_at = dict.fromkeys(range(count), dead_at)
    house.plan.run_until(dead_at + 8)
    assert len(house.plan.flips) == count
    assert all(times[0] - dead_at <= 5.0 for times in house.plan.flips.values())


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
@pytest.mark.parametrize(
    ("protocol", "baud", "count", "module"),
    [
        (LineProtocol.WISCO, 4800, 32, DIO100),
        (LineProtocol.WISCO, 57600, 1, DO100),
        (LineProtocol.MODBUS_RTU, 9600, 8, DIO100),
        (LineProtocol.MODBUS_ASCII, 4800, 32, DIO100),
    ],
)
def test_random_loss_takes_nobody_offline(
    protocol: LineProtocol, baud: int, count: int, module: ModuleType
) -> None:
    """5 % of all exchanges lost for an hour: no flip (docs/failures.md C6)."""
    dice = random.Random(f"{protocol} {baud}")  # noqa: S311  # losses, no secrets
    plan = VirtualPlan(
        line_of(module, count), Costs.of(protocol, baud), lambda *_: dice.random() >= 0.05
    )
    plan.run_until(3600.0)
    assert plan.all_online()
    assert not plan.flips


@pytest.mark.parametrize("protocol", list(LineProtocol))
@pytest.mark.parametrize("module", [DIO100, DO100])
def test_thirty_one_dead_modules_of_32_cost_the_live_one_half_a_second(
    protocol: LineProtocol, module: ModuleType
) -> None:
    """From cold, and after they died while online: docs/failures.md D1."""
    house = House(protocol, 9600, 32, module)
    normal_s = (2 if module.inputs else 1) * house.costs.good_s
    house.dies_at = dict.fromkeys(range(31), 0.0)
    house.plan.run_until(80.0)
    assert house.plan.longest_gap_s(31, 20.0, 80.0) <= normal_s + 0.5
    house.dies_at.clear()
    dead_at = house.settle()
    house.dies_at = dict.fromkeys(range(31), dead_at)
    house.plan.run_until(dead_at + 90)
    assert sum(presence.online for presence in house.plan.presences.values()) == 1
    assert house.plan.longest_gap_s(31, dead_at + 30, dead_at + 90) <= normal_s + 0.5


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_one_dying_module_costs_the_others_little(protocol: LineProtocol) -> None:
    """While it is not offline yet, only every second exchange is a try of the dead module."""
    house = House(protocol, 9600, 4, output_sweep_s=0.0)
    dead_at = house.settle()
    house.dies_at[0] = dead_at
    house.plan.run_until(dead_at + 30)
    polls = 8
    time_out_s = house.costs.silent_s + house.costs.late_window_s
    for address in (1, 2, 3):
        gap_s = house.plan.longest_gap_s(address, dead_at, dead_at + 30)
        assert gap_s <= polls * (house.costs.good_s + time_out_s)


def test_a_module_that_never_answers_for_its_outputs_is_not_online() -> None:
    """A module that answers for inputs but never for outputs goes offline."""
    plan = VirtualPlan(line_of(DIO100, 2), Costs.of(LineProtocol.WISCO, 9600), lambda *_: True)
    while not plan.all_online():
        plan.step()
    begun = plan.now
    presence = plan.presences[0]
    while presence.online and plan.now < begun + 60:
        due = plan.plan.next(plan.now)
        assert isinstance(due, Poll)
        plan.now += 0.12
        if due == Poll(0, Kind.OUTPUTS):
            presence.missed(due.kind, plan.now)
            for address in fallen_silent(plan.presences, plan.now):
                plan.presences[address].gone(plan.now)
        else:
            plan.presences[due.address].answered(plan.now)
    assert not presence.online
    assert plan.now - begun <= 5.0
    assert plan.presences[1].online


# --- where something is due ---------------------------------------------------------------------


def _absent(now: float) -> Presence:
    """A module that was asked so often in vain that its next probe is half a minute away."""
    presence = Presence()
    for _ in range(10):
        presence.absent(now)
    assert presence.probe_at == now + 30.0
    return presence


def test_a_module_where_something_is_due_is_probed_each_second() -> None:
    """A module with a due order is probed each second, and normally after that."""
    presence, probes = _absent(100.0), UrgentProbes()
    probed = []
    for tick in range(50):
        now = 100.0 + tick / 10
        probes.work({1: presence}, now)
        if presence.urgent:
            probed.append(now)
            presence.absent(now + 0.05)
    assert probed == pytest.approx([100.0, 101.0, 102.0, 103.0, 104.0])
    assert presence.probe_at == pytest.approx(104.05 + 30.0)


def test_several_share_the_one_probe_a_second_in_turn() -> None:
    """Several such modules share one probe a second, in turn."""
    presences, probes = {n: _absent(100.0) for n in (1, 2, 3)}, UrgentProbes()
    probed = []
    for tick in range(60):
        now = 100.0 + tick / 10
        probes.work(presences, now)
        for n, presence in presences.items():
            if presence.urgent:
                probed.append(n)
                presence.absent(now)
    assert probed == [1, 2, 3, 1, 2, 3]


def test_a_probe_that_takes_long_is_made_more_rarely() -> None:
    """At most half of the time of the line goes into such probes."""
    presence, probes = _absent(100.0), UrgentProbes()
    probes.work({1: presence}, 100.0)
    presence.absent(101.5)
    probes.work({1: presence}, 101.5)
    assert not presence.urgent
    assert probes.next_at == 103.0
    probes.work({1: presence}, 103.0)
    assert presence.urgent


def test_where_nothing_is_due_or_all_are_there_no_probe_is_urgent() -> None:
    """Without a due order, or with all modules online, no probe is urgent."""
    probes = UrgentProbes()
    for due in ({}, {1: online_presence(100.0)}):
        probes.work(due, 100.0 + URGENT_PROBE_S)
        assert probes.next_at == NEVER_DUE
        assert not any(presence.urgent for presence in due.values())
