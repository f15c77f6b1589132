"""In which order motors are stopped, and when that is given up: rules alone, no wire."""

import pytest

from bridge.line.rules.halt import (
    AGAIN_S,
    BUDGET_S,
    PATIENCE_S,
    Act,
    Halt,
    Moving,
    Pause,
    Step,
    off_masks,
)

T = 100.0


def _live(address: int, heard_at: float = T) -> Moving:
    return Moving(address, met=True, answers=True, heard_at=heard_at)


def _silent(address: int) -> Moving:
    return Moving(address, met=True, answers=False, heard_at=T - 5)


def _away(address: int) -> Moving:
    return Moving(address, met=False, answers=False, heard_at=T - 60)


def test_where_no_motor_runs_it_is_over_at_once() -> None:
    """The end of such a line waits for nothing."""
    assert Halt(T).next([], T) is None


def test_live_modules_come_first_and_all_are_told_before_any_is_read() -> None:
    """One OFF each, then a look at each, and only then those that are silent."""
    halt, moving = Halt(T), [_silent(1), _live(2), _away(3), _live(4)]
    steps = []
    for _ in range(4):
        step = halt.next(moving, T)
        assert isinstance(step, Step)
        steps.append((step.address, step.act))
        if step.act is Act.OFF:
            halt.told(step.address)
        else:
            moving = [module for module in moving if module.address != step.address]
    assert steps == [(2, Act.OFF), (4, Act.OFF), (2, Act.LOOK), (4, Act.LOOK)]
    assert halt.next(moving, T) == Step(1, Act.OFF)


def test_who_was_heard_last_is_told_first() -> None:
    """The module that was heard last gets OFF first, as it is most likely to answer."""
    assert Halt(T).next([_live(1, T - 2), _live(2, T - 0.1)], T) == Step(2, Act.OFF)


def test_who_does_not_answer_its_off_goes_behind_all_others() -> None:
    """A module that does not answer its OFF is tried again after all others."""
    halt = Halt(T)
    assert halt.next([_live(1), _live(2, T - 1)], T) == Step(1, Act.OFF)
    halt.failed(1, T + 1)
    moving = [_silent(1), _live(2, T - 1)]
    assert halt.next(moving, T + 1) == Step(2, Act.OFF)
    halt.told(2)
    assert halt.next([*moving, _away(3)], T + 1) == Step(2, Act.LOOK)
    assert halt.next([_silent(1), _away(3)], T + 1) == Step(3, Act.MEET)


def test_an_answer_that_is_not_obeyed_is_told_again_after_a_pause_before_the_silent_ones() -> None:
    """A module that answers but does not obey is tried again before silent ones."""
    halt = Halt(T)
    halt.failed(1, T)
    assert halt.next([_live(1)], T) == Pause(T + AGAIN_S)
    assert halt.next([_live(1), _silent(2)], T) == Step(2, Act.OFF)
    assert halt.next([_live(1), _silent(2)], T + AGAIN_S) == Step(1, Act.OFF)


@pytest.mark.parametrize("module", [_live(1), _silent(1), _away(1)])
def test_what_failed_is_given_up_when_patience_ends(module: Moving) -> None:
    """Failed modules are tried again until the time of the stop is over."""
    halt = Halt(T)
    halt.failed(1, T)
    assert isinstance(halt.next([module], T + PATIENCE_S - 0.01), Step)
    assert halt.next([module], T + PATIENCE_S) is None


def test_what_was_never_tried_has_the_whole_budget() -> None:
    """Many that are silent take long: each has its turn as long as there is time."""
    halt = Halt(T)
    assert halt.next([_away(1)], T + BUDGET_S - 0.01) == Step(1, Act.MEET)
    assert halt.next([_away(1)], T + BUDGET_S) is None
    assert halt.next([_live(1)], T + BUDGET_S) is None


def test_after_a_port_that_was_gone_all_are_met_and_tried_anew() -> None:
    """An adapter that is back may lead elsewhere: nothing is written before it was met."""
    halt = Halt(T)
    halt.failed(1, T)
    halt.told(2)
    halt.port_lost()
    back = Moving(2, met=False, answers=True, heard_at=T)
    assert halt.next([_away(1), back], T + PATIENCE_S + 1) == Step(2, Act.MEET)
    assert halt.next([_away(1)], T + PATIENCE_S + 1) == Step(1, Act.MEET)


def test_a_module_that_was_met_late_is_told_off_all_the_same() -> None:
    """A module that answers late in the stop still gets its OFF."""
    halt = Halt(T)
    halt.failed(1, T)
    halt.met(1)
    assert halt.next([_live(1)], T + PATIENCE_S + 1) == Step(1, Act.OFF)


@pytest.mark.parametrize(
    ("off", "ours", "masks"),
    [
        (0b1, 0b11, [0b1]),
        (0b0101, 0b1111, [0b0111]),  # the gap is the other direction of a cover
        (0b0001_0001, 0b0011_0011, [0b0001, 0b0001_0000]),  # the gap is another program's
        (0b1000_0000_0000_0001, 0xFFFF, [0xFFFF]),
        (0b11, 0b11, [0b11]),
        (0b0100, 0b1111_1100, [0b0100]),
    ],
)
def test_a_write_spans_outputs_of_covers_alone(off: int, ours: int, masks: list[int]) -> None:
    """A write covers only outputs of covers, because outputs in between go OFF too."""
    assert list(off_masks(off, ours)) == masks
