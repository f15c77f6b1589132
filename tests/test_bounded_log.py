"""What can repeat is bounded in the log: the first at once, repeats counted, the end told."""

import logging

import pytest

from bridge.bounded_log import BURST_LINES, MOST_LINES_AN_HOUR, REFILL_S, BoundedLog, Cause

_HOUR_S = 3600.0


class Hours:
    """A bounded log on a clock that the test sets."""

    def __init__(self, caplog: pytest.LogCaptureFixture) -> None:
        caplog.set_level(logging.INFO)
        self.now = 0.0
        self._caplog = caplog
        self.log = BoundedLog(logging.getLogger("test"), lambda: self.now)

    def tell(self, text: str, cause: Cause = Cause.PORT, subject: str = "main") -> None:
        """Log a fault of one subject."""
        self.log.tell(cause, subject, logging.WARNING, text)

    @property
    def lines(self) -> list[str]:
        """What was logged."""
        return [record.getMessage() for record in self._caplog.records]


@pytest.fixture
def hours(caplog: pytest.LogCaptureFixture) -> Hours:
    """A log at the instant 0."""
    return Hours(caplog)


def test_the_first_is_told_at_once_with_its_end(hours: Hours) -> None:
    """A fault that comes once gives one line, and one when it is over."""
    hours.tell("gone")
    hours.log.end(Cause.PORT, "main", "back")
    assert hours.lines == ["gone", "back"]


def test_an_end_of_what_was_not_told_says_nothing(hours: Hours) -> None:
    """Without a fault there is no end to tell."""
    hours.log.end(Cause.PORT, "main", "back")
    assert hours.lines == []


def test_repeats_are_counted_and_told_in_sum(hours: Hours) -> None:
    """What the budget does not allow is told later: the latest text, and how many came before."""
    for count in range(BURST_LINES + 10):
        hours.tell(f"fault {count}")
    assert len(hours.lines) == BURST_LINES
    hours.now = REFILL_S
    hours.log.tick()
    assert hours.lines[-1] == "fault 15 (and 9 times more since the last line about it)"
    hours.log.tick()
    assert len(hours.lines) == BURST_LINES + 1


def test_an_end_that_had_no_line_left_is_told_later(hours: Hours) -> None:
    """The last line about a fault that is over says that it is over."""
    for _ in range(BURST_LINES):
        hours.tell("gone")
    hours.log.end(Cause.PORT, "main", "back")
    assert hours.lines[-1] == "gone"
    hours.now = REFILL_S
    hours.log.tick()
    assert hours.lines[-1] == "back"


def test_a_fault_of_one_subject_costs_another_no_line(hours: Hours) -> None:
    """Each line and each station has a budget of its own."""
    for _ in range(100):
        hours.tell("gone")
    hours.tell("gone too", subject="second")
    hours.tell("other", cause=Cause.STATION)
    assert hours.lines[-2:] == ["gone too", "other"]


@pytest.mark.parametrize("period_s", [0.5, 1.0, 3.0, 7.0, 20.0, 60.0, 301.0])
def test_no_period_gets_more_than_20_lines_in_any_hour(hours: Hours, period_s: float) -> None:
    """A fault that flaps for hours stays within the bound in every hour, at any period."""
    at: list[float] = []
    told = 0
    while hours.now < 4 * _HOUR_S:
        hours.tell("gone")
        hours.now += period_s / 2
        hours.log.end(Cause.PORT, "main", "back")
        hours.now += period_s / 2
        hours.log.tick()
        at += [hours.now] * (len(hours.lines) - told)
        told = len(hours.lines)
    worst = max(sum(begin <= other < begin + _HOUR_S for other in at) for begin in at)
    assert worst <= MOST_LINES_AN_HOUR
    assert told > 4 * 10  # and it is told all the time that it goes on


def test_subjects_are_bounded(hours: Hours) -> None:
    """A mistake that makes subjects of what came from outside cannot fill the memory."""
    for count in range(10_000):
        hours.tell("gone", subject=str(count))
    assert len(hours.log) <= 4096
