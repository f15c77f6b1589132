"""The position of a cover by the time of its motor, on a virtual clock."""

import pytest

from bridge.config.schema import CoverConfig
from bridge.line.rules.cover import CoverMotion, Way
from bridge.model import CoverState

UP, DOWN = 0b01, 0b10
BOTH = UP | DOWN
OPEN_S, CLOSE_S = 20.0, 10.0
T = 100.0
OVERRUN_S = 1.0  # 5 % of opening


def _cover() -> CoverMotion:
    return CoverMotion(CoverConfig("shutter", "Shutter", 1, 2, OPEN_S, CLOSE_S))


def _order(cover: CoverMotion, output: int, at: float, goal: float | None = None) -> None:
    """An order ON, and the read that finds it obeyed."""
    cover.aim(goal)
    cover.ordered(output, output, at)
    cover.observe(output, at + 0.1)


def _stop(cover: CoverMotion, output: int, at: float) -> None:
    cover.ordered(output, 0, at)
    cover.observe(0, at + 0.1)


def _over_at(cover: CoverMotion, since: float) -> float:
    """Return when its motor has to stop."""
    now = since
    while not cover.is_over(now):
        now += 0.01
        assert now < since + 100
    return now


def _closed() -> CoverMotion:
    """A cover that was driven to its lower end until T."""
    cover = _cover()
    _order(cover, DOWN, T - 15)
    _stop(cover, DOWN, T - 3)
    assert cover.shown(T) == (CoverState.CLOSED, 0)
    return cover


# --- what is known ----------------------------------------------------------------------------


def test_after_a_start_nothing_is_known() -> None:
    """After a start the position is not known, also after reads that find both OFF."""
    cover = _cover()
    cover.observe(0, T)
    assert cover.shown(T) == (CoverState.STOPPED, None)
    assert not cover.is_over(T + 1000)


def test_a_position_of_the_line_before_is_used_until_a_read_finds_it_moving() -> None:
    """A read that finds both OFF leaves it; one that finds it moving drops it."""
    cover = _cover()
    cover.recall(40.0)
    cover.observe(0, T)
    assert (cover.shown(T), cover.standing) == ((CoverState.STOPPED, 40), 40.0)
    for outputs in (UP, BOTH):
        cover = _cover()
        cover.recall(40.0)
        cover.observe(outputs, T)
        cover.observe(0, T + 5)
        assert (cover.shown(T + 6), cover.standing) == ((CoverState.STOPPED, None), None)


def test_a_moving_cover_does_not_stand() -> None:
    """From the order on, whether it was obeyed or not."""
    cover = _closed()
    assert cover.standing == 0.0
    cover.ordered(UP, UP, T)
    assert cover.standing is None


def test_a_first_run_takes_the_whole_way_and_then_the_end_is_known() -> None:
    """The first run takes the whole way and a little more; then the position is known."""
    cover = _cover()
    _order(cover, UP, T)
    assert cover.shown(T + 10) == (CoverState.OPENING, None)
    assert cover.shown(T + OPEN_S) == (CoverState.OPENING, 100)
    assert _over_at(cover, T) == pytest.approx(T + OPEN_S + OVERRUN_S, abs=0.02)
    _stop(cover, UP, T + OPEN_S + OVERRUN_S)
    assert cover.shown(T + 30) == (CoverState.OPEN, 100)


def test_each_direction_has_its_own_time() -> None:
    """Half of the way up takes 10 s, half of the way down 5 s."""
    cover = _closed()
    _order(cover, UP, T)
    assert cover.shown(T + 10) == (CoverState.OPENING, 50)
    _stop(cover, UP, T + 10)
    assert cover.shown(T + 11) == (CoverState.STOPPED, 50)
    _order(cover, DOWN, T + 20)
    assert cover.shown(T + 22.5) == (CoverState.CLOSING, 25)
    assert _over_at(cover, T + 20) == pytest.approx(T + 20 + 5 + 0.5, abs=0.02)


def test_a_run_to_a_position_ends_there() -> None:
    """Without the little more of the ends."""
    cover = _closed()
    _order(cover, UP, T, goal=30)
    assert _over_at(cover, T) == pytest.approx(T + 6, abs=0.02)
    _stop(cover, UP, T + 6)
    assert cover.shown(T + 7) == (CoverState.STOPPED, 30)


def test_a_new_goal_on_the_way_counts_from_where_it_began() -> None:
    """The motor is told ON again while it runs: it runs on, until the new end of its way."""
    cover = _closed()
    _order(cover, UP, T, goal=30)
    _order(cover, UP, T + 3, goal=80)
    assert cover.shown(T + 4) == (CoverState.OPENING, 20)
    assert _over_at(cover, T) == pytest.approx(T + 16, abs=0.02)
    _order(cover, UP, T + 5)
    assert _over_at(cover, T) == pytest.approx(T + OPEN_S + OVERRUN_S, abs=0.02)


def test_from_its_end_it_runs_the_whole_way_again() -> None:
    """A run away from an end takes the whole way, because the position may be wrong."""
    cover = _closed()
    _order(cover, DOWN, T)
    assert cover.shown(T + 5) == (CoverState.CLOSING, 0)
    assert _over_at(cover, T) == pytest.approx(T + CLOSE_S + 0.5, abs=0.02)


def test_just_before_an_end_it_is_not_told_to_be_there() -> None:
    """0 and 100 are for the ends alone: what follows from them must not be wrong."""
    cover = _closed()
    _order(cover, UP, T)
    _stop(cover, UP, T + 0.05)
    assert cover.shown(T + 1) == (CoverState.STOPPED, 1)


# --- what others do -----------------------------------------------------------------------------


def test_what_somebody_else_moves_is_stopped_at_the_end_and_known_only_there() -> None:
    """A movement by another master ends after the whole way, and the position is known there."""
    cover = _closed()
    cover.observe(UP, T)
    assert cover.unasked
    assert cover.shown(T + 10) == (CoverState.OPENING, None)
    assert _over_at(cover, T) == pytest.approx(T + OPEN_S + OVERRUN_S, abs=0.02)
    _stop(cover, UP, T + OPEN_S + OVERRUN_S)
    assert cover.shown(T + 30) == (CoverState.OPEN, 100)
    assert not cover.unasked


def test_what_somebody_else_stops_stands_anywhere() -> None:
    """He did it at some instant since the last read."""
    cover = _closed()
    _order(cover, UP, T)
    cover.observe(0, T + 10)
    assert cover.shown(T + 10) == (CoverState.STOPPED, None)


def test_an_output_that_is_on_at_the_start_is_a_movement() -> None:
    """An output that is ON at the start counts as a movement for at most the whole way."""
    cover = _cover()
    cover.observe(DOWN, T)
    assert cover.shown(T) == (CoverState.CLOSING, None)
    assert _over_at(cover, T) == pytest.approx(T + CLOSE_S + 0.5, abs=0.02)


def test_both_on_is_over_at_once() -> None:
    """Another master did that; where it is then it is not known."""
    cover = _closed()
    cover.observe(BOTH, T)
    assert cover.is_over(T)
    assert cover.shown(T) == (CoverState.STOPPED, None)
    cover.observe(0, T + 1)
    assert not cover.is_over(T + 1)


def test_both_on_while_it_moves_is_over_too() -> None:
    """Both outputs ON means that the movement is over."""
    cover = _closed()
    _order(cover, UP, T)
    cover.observe(BOTH, T + 1)
    assert cover.is_over(T + 1)
    cover.observe(DOWN, T + 2)
    assert cover.shown(T + 2) == (CoverState.CLOSING, None)


def test_the_other_direction_without_a_stop_is_a_new_movement() -> None:
    """A change of direction between two reads is a new movement."""
    cover = _closed()
    _order(cover, UP, T)
    cover.observe(DOWN, T + 5)
    assert cover.way is Way.CLOSING
    assert cover.shown(T + 6) == (CoverState.CLOSING, None)


# --- what is not certain ------------------------------------------------------------------------


def test_an_order_that_nobody_saw_obeyed_counts_as_running() -> None:
    """An order that no read confirmed is not shown as movement, but its time runs."""
    cover = _closed()
    cover.ordered(UP, UP, T)
    assert cover.shown(T + 5) == (CoverState.CLOSED, 0)
    assert cover.way is Way.OPENING
    assert _over_at(cover, T) == pytest.approx(T + OPEN_S + OVERRUN_S, abs=0.02)


def test_an_order_that_was_not_obeyed_moved_nothing() -> None:
    """The read right after it found it OFF: it is where it was."""
    cover = _closed()
    cover.ordered(UP, UP, T)
    cover.observe(0, T + 0.1)
    assert cover.shown(T + 1) == (CoverState.CLOSED, 0)


def test_an_order_that_was_found_obeyed_late_began_at_any_time() -> None:
    """A movement whose order was confirmed late gets the whole time from there."""
    cover = _closed()
    cover.ordered(UP, UP, T)
    cover.observe(UP, T + 4)
    assert cover.shown(T + 10) == (CoverState.OPENING, None)
    assert _over_at(cover, T) == pytest.approx(T + 4 + OPEN_S + OVERRUN_S, abs=0.02)


def test_a_stop_that_was_found_obeyed_late_stands_anywhere() -> None:
    """After a stop that was confirmed late the position is not known, except at the end."""
    cover = _closed()
    _order(cover, UP, T)
    cover.ordered(UP, 0, T + 10)
    cover.observe(0, T + 14)
    assert cover.shown(T + 14) == (CoverState.STOPPED, None)
    _order(cover, DOWN, T + 20)
    cover.ordered(DOWN, 0, T + 31)
    cover.observe(0, T + 35)
    assert cover.shown(T + 35) == (CoverState.CLOSED, 0)


def test_a_module_that_was_away_meanwhile_left_it_anywhere() -> None:
    """The motor has to stop when it had to before; a cover that stood stands where it stood."""
    cover = _closed()
    cover.lost()
    cover.observe(0, T)
    assert cover.shown(T) == (CoverState.CLOSED, 0)
    _order(cover, UP, T)
    cover.lost()
    assert cover.is_over(T + 30)
    cover.observe(UP, T + 18)
    assert cover.shown(T + 18) == (CoverState.OPENING, None)
    assert _over_at(cover, T) == pytest.approx(T + OPEN_S + OVERRUN_S, abs=0.02)
    _stop(cover, UP, T + 21)
    assert cover.shown(T + 22) == (CoverState.STOPPED, None)
