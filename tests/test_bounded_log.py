"""What can repeat is bounded in the log: the first at once, repeats counted, the end told."""

import logging
from pathlib import Path

import pytest

from bridge.bounded_log import (
    BURST_LINES,
    MOST_LINES_AN_HOUR,
    MOST_SUBJECTS,
    REFILL_S,
    BoundedLog,
    Budgets,
    Cause,
)

_HOUR_S = 3600.0
TROUBLESHOOTING = Path(__file__).parents[1] / "docs/troubleshooting.md"


class Hours:
    """A bounded log on a clock that the test sets."""

    def __init__(self, caplog: pytest.LogCaptureFixture) -> None:
        caplog.set_level(logging.INFO)
        self.now = 0.0
        self._caplog = caplog
        self.budgets = Budgets(lambda: self.now)
        self.log = BoundedLog(logging.getLogger("test"), lambda: self.now, self.budgets)

    def tell(self, text: str, cause: Cause = Cause.PORT, subject: str = "main") -> None:
        """Log a fault of one subject."""
        self.log.tell(cause, subject, logging.WARNING, text)

    @property
    def lines(self) -> list[str]:
        """Return the logged lines."""
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
    """Lines over the budget are logged later: the latest text, with their number."""
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
    assert len(hours.budgets) <= MOST_SUBJECTS + 1
    assert len(hours.lines) <= MOST_SUBJECTS + BURST_LINES
    hours.tell("gone", subject="0")
    assert hours.lines[-1] == "gone"  # those that were there keep their budget


def test_forgotten_subjects_make_room(hours: Hours) -> None:
    """Subjects that ended long ago are forgotten, and a new subject has its own budget."""
    for count in range(MOST_SUBJECTS):
        hours.tell("gone", subject=str(count))
        hours.log.end(Cause.PORT, str(count), "back")
    hours.now = BURST_LINES * REFILL_S
    for count in range(2 * BURST_LINES):
        hours.tell(f"gone {count}", subject=f"new {count}")
    assert hours.lines[-1] == f"gone {2 * BURST_LINES - 1}"
    assert len(hours.budgets) == MOST_SUBJECTS


def test_amounts_are_summed_up(hours: Hours) -> None:
    """A line that tells how many of something came tells of all since the last line."""
    for _ in range(BURST_LINES + 10):
        hours.log.tell(Cause.STRAYS, "main", logging.WARNING, "{amount} bytes", amount=3)
    assert hours.lines == ["3 bytes"] * BURST_LINES
    hours.now = REFILL_S
    hours.log.tick()
    assert hours.lines[-1] == "30 bytes (and 9 times more since the last line about it)"


def test_what_goes_on_can_be_told_once(hours: Hours) -> None:
    """A state that lasts is not told again before it ended."""
    for _ in range(3):
        hours.log.tell(Cause.DISK, "", logging.WARNING, "full", once=True)
    hours.log.end(Cause.DISK, "", "written")
    hours.log.tell(Cause.DISK, "", logging.WARNING, "full", once=True)
    assert hours.lines == ["full", "written", "full"]


def test_what_begins_well_is_told_too(hours: Hours) -> None:
    """With `always` an end is logged without a beginning, within the same budget."""
    for _ in range(2 * BURST_LINES):
        hours.log.end(Cause.PORT, "main", "open", always=True)
    assert hours.lines == ["open"] * BURST_LINES


def test_logs_of_one_process_share_what_they_may_say(
    hours: Hours, caplog: pytest.LogCaptureFixture
) -> None:
    """A thread that is started anew has no new budget; each line has the name of its module."""
    for count in range(20):
        log = BoundedLog(logging.getLogger(f"module{count}"), lambda: hours.now, hours.budgets)
        log.tell(Cause.PORT, "main", logging.WARNING, "gone")
    assert hours.lines == ["gone"] * BURST_LINES
    hours.now = REFILL_S
    hours.budgets.tick()
    assert caplog.records[-1].name == "module19"


def test_at_the_end_everything_is_told(hours: Hours) -> None:
    """Lines that are held back at the end of the process are logged."""
    for count in range(BURST_LINES + 3):
        hours.tell(f"fault {count}")
    hours.budgets.close()
    hours.budgets.close()
    assert hours.lines[-1] == "fault 8 (and 2 times more since the last line about it)"
    assert len(hours.lines) == BURST_LINES + 1


def test_an_error_is_logged_with_its_trace(hours: Hours, caplog: pytest.LogCaptureFixture) -> None:
    """A fault of the program can be found, and its record says which cause it has."""
    hours.log.tell(Cause.MESSAGE, "", logging.ERROR, "failed", error=ValueError("why"))
    assert "ValueError: why" in caplog.text
    assert caplog.records[-1].cause == "MESSAGE"  # type: ignore[attr-defined]  # an extra


def test_the_words_for_repeats_are_explained(hours: Hours) -> None:
    """docs/troubleshooting.md shows them as they are logged."""
    for _ in range(BURST_LINES + 141):
        hours.tell("gone")
    hours.now = REFILL_S
    hours.log.tick()
    text = " ".join(TROUBLESHOOTING.read_text().split())
    assert f"`{hours.lines[-1].removeprefix('gone ')}`" in text
