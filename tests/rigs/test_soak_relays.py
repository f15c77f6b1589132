from collections import Counter

import pytest
from soak.disturbances import Disturbances
from soak.relays import Move, Relays, Rules

from bridge.simulator.module import Switching

PULSE, READ_ONLY, MAX_ON, ON_LOSS, OPEN, CLOSE = 2, 3, 4, 5, 9, 10
RULES = Rules(
    pulses=frozenset({PULSE}),
    longest_hold_s=1.0,
    read_only=READ_ONLY,
    motors=frozenset({OPEN, CLOSE}),
    way_s=2.5,
    max_on=MAX_ON,
    max_on_s=5.0,
    on_loss=ON_LOSS,
    after_s=3.0,
    groups=((OPEN, CLOSE),),
    dead_time_s=0.4,
)


class House:
    """Relays of one station, and what was found wrong with them."""

    def __init__(self) -> None:
        self.harms: Counter[str] = Counter()
        self.disturbances = Disturbances()
        self.relays = Relays(RULES, self.disturbances, lambda name, _: self.harms.update([name]))

    def on(self, at: float, output: int, *, hand: bool = False) -> None:
        """An output goes ON."""
        self.relays.take(move(at, output, hand=hand))

    def off(self, at: float, output: int, *, hand: bool = False) -> None:
        """An output goes OFF."""
        self.relays.take(move(at, output, value=False, hand=hand))

    @property
    def found(self) -> list[str]:
        """The names of what was wrong."""
        return sorted(self.harms)


def move(at: float, output: int, *, value: bool = True, hand: bool = False) -> Move:
    """A relay of station `s` obeyed a frame, or a hand."""
    return Move("s", Switching(at, output, value, b"" if hand else b"a frame", changed=True))


@pytest.fixture
def house() -> House:
    """A house in which nothing happened yet."""
    return House()


TOO_LONG = "motors and max_on outputs ON too long"
NOT_STOPPED = "motors that a stop or reload left ON for 3 s"
TOGETHER = "interlocked outputs ON together"
SHORT = "dead times cut short"
LEFT_ON = "pulses that left a relay ON"
TWICE = "on_loss twice in a loss"


@pytest.mark.parametrize(("ran_s", "found"), [(4.4, []), (4.6, [TOO_LONG])])
def test_a_motor_runs_its_way_and_the_bound(house: House, ran_s: float, found: list[str]) -> None:
    """Longer is wrong, whether it has ended or goes on."""
    house.on(10.0, OPEN)
    house.relays.look(10.0 + ran_s)
    house.relays.look(10.0 + ran_s)
    house.off(10.0 + ran_s, OPEN)
    assert house.found == found
    assert sum(house.harms.values()) == len(found)


def test_a_motor_that_a_hand_started_has_the_time_of_a_sweep_more(house: House) -> None:
    """The bridge has to find it first."""
    house.on(10.0, OPEN, hand=True)
    house.relays.look(16.4)
    assert house.found == []
    house.relays.look(16.6)
    assert house.found == [TOO_LONG]


def test_a_motor_may_run_on_while_its_module_cannot_be_told(house: House) -> None:
    """The bound begins anew when it can, with the longest pause between two attempts."""
    house.on(10.0, OPEN)
    house.disturbances.begin(["s"], 11.0)
    house.relays.look(40.0)
    house.disturbances.end(["s"], 40.0)
    house.relays.look(51.4)
    assert house.found == []
    house.relays.look(51.6)
    assert house.found == [TOO_LONG]


@pytest.mark.parametrize(("off_at", "found"), [(15.2, []), (15.4, [NOT_STOPPED])])
def test_a_stop_stops_motors_within_3_s(house: House, off_at: float, found: list[str]) -> None:
    """A stop stops each motor within 3 s, unless its module has a fault."""
    house.on(11.9, OPEN)
    house.disturbances.begin(["another"], 10.0)
    house.disturbances.began_anew(["s"], 12.0)
    house.off(off_at, OPEN)
    assert house.found == found


def test_a_stop_does_not_reach_a_module_that_is_not_well(house: House) -> None:
    """A motor whose module has a fault at the stop is named in the log."""
    house.on(11.9, OPEN)
    house.disturbances.began_anew(["s"], 12.0)
    house.disturbances.begin(["s"], 13.0)
    house.off(16.0, OPEN)
    assert house.found == []
    house.on(20.0, CLOSE)
    assert house.relays.moving() == [("s", CLOSE)]


def test_both_directions_are_never_on_by_a_frame(house: House) -> None:
    """A frame never causes both directions ON, except after a very recent manual switching."""
    house.on(10.0, OPEN, hand=True)
    house.on(10.5, CLOSE)
    assert house.found == []
    house.off(10.6, CLOSE)
    house.on(11.5, CLOSE)
    assert house.found == [TOGETHER]


def test_a_direction_waits_for_the_dead_time_of_the_other(house: House) -> None:
    """From when the other went OFF."""
    house.on(10.0, OPEN)
    house.off(11.0, OPEN)
    house.on(11.45, CLOSE)
    assert house.found == []
    house.off(11.5, CLOSE)
    house.on(11.7, OPEN)
    assert house.found == [SHORT]


def test_a_pulse_that_does_not_end_left_its_relay_on(house: House) -> None:
    """Counted from its last frame; what a hand switched is the hand's."""
    house.on(10.0, PULSE)
    house.on(10.9, PULSE)
    house.off(12.0, PULSE, hand=True)
    house.on(20.0, PULSE, hand=True)
    house.relays.look(30.0)
    assert house.found == []
    house.on(31.0, PULSE)
    house.relays.look(33.0)
    assert house.found == [LEFT_ON]


def test_max_on_and_covers_switch_off_without_a_command(house: House) -> None:
    """`max_on` after its time, which pauses that were too short to be seen do not begin anew."""
    house.on(10.0, MAX_ON)
    assert house.relays.rule(move(14.0, MAX_ON, value=False), 0.0, 0.0) is None
    house.off(12.0, MAX_ON)
    house.on(12.1, MAX_ON)
    assert house.relays.rule(move(15.0, MAX_ON, value=False), 0.0, 0.0) == "max_on"
    assert house.relays.rule(move(15.0, MAX_ON), 0.0, 0.0) is None
    assert house.relays.rule(move(15.0, OPEN, value=False), 0.0, 0.0) == "cover"
    assert house.relays.rule(move(15.0, OPEN), 0.0, 0.0) is None


def test_max_on_is_not_forgotten(house: House) -> None:
    """`max_on` allows its time, a sweep, and the bound."""
    house.on(10.0, MAX_ON)
    house.relays.look(18.9)
    assert house.found == []
    house.relays.look(19.1)
    assert house.found == [TOO_LONG]


def test_on_loss_fires_after_its_time_and_once_a_loss(house: House) -> None:
    """A loss is known by the last ping before it; a daemon that was started knows of none."""
    assert house.relays.rule(move(20.0, ON_LOSS), 18.0, 2.0) is None
    assert house.relays.rule(move(20.0, ON_LOSS, value=False), 10.0, 10.0) is None
    assert house.relays.rule(move(21.0, ON_LOSS), 18.0, 3.0) == "on_loss"
    assert house.relays.rule(move(41.0, ON_LOSS), 38.0, 3.0) == "on_loss"
    house.relays.forget_losses()
    assert house.relays.rule(move(43.0, ON_LOSS), 38.0, 5.0) == "on_loss"
    assert house.found == []
    assert house.relays.rule(move(45.0, ON_LOSS), 38.0, 7.0) == "on_loss"
    assert house.found == [TWICE]


def test_a_write_of_gaps_may_undo_a_hand_but_not_at_a_read_only_output(house: House) -> None:
    """Between the read and the write lies a moment; what is not ours is not written over."""
    for output in (1, READ_ONLY):
        house.on(10.0, output, hand=True)
    assert house.relays.hand_before(move(10.5, 1, value=False))
    assert not house.relays.hand_before(move(11.5, 1, value=False))
    assert not house.relays.hand_before(move(10.5, READ_ONLY, value=False))
    assert not house.relays.hand_before(move(10.5, 1)._replace(pulse=True))
