"""Something that comes and goes for hours on a virtual clock, and what the log says of it."""

import logging
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bridge.bounded_log import Budgets, Cause

HOUR_S = 3600.0
_LONGEST_STEP_S = 30.0  # the budgets are looked after once a minute at least

Step = Callable[[], None]


class Flap:
    """One period of coming and going, for some hours.

    Attributes:
        budgets: Those of the process.
        clock: What tells the time; a scenario with a clock of its own puts it here.
    """

    def __init__(self, period_s: float, hours: int) -> None:
        self.period_s = period_s
        self.length_s = hours * HOUR_S
        self.clock: Callable[[], float] = self._own_clock
        self.budgets = Budgets(self.now)
        self._now = 0.0

    def alternate(self, begin: Step, end: Step) -> None:
        """Let it begin and end, once each in a period."""
        while self._now < self.length_s:
            for step in (begin, end):
                step()
                self.pass_time(self.period_s / 2)

    def pass_time(self, seconds: float) -> None:
        """Let time pass, in steps in which what is held back is told."""
        until = self._now + seconds
        while self._now < until:
            self._now = min(until, self._now + _LONGEST_STEP_S)
            self.budgets.tick()

    def now(self) -> float:
        """Return the instant, on whichever clock it is."""
        return self.clock()

    def _own_clock(self) -> float:
        return self._now


class LogCount(logging.Handler):
    """Notes when each cause of each subject had a line.

    Attributes:
        unbounded: What came past the bounded log.
    """

    def __init__(self, flap: Flap) -> None:
        super().__init__(logging.INFO)
        self.unbounded: list[str] = []
        self._flap = flap
        self._at: defaultdict[tuple[str, str], list[float]] = defaultdict(list)

    def emit(self, record: logging.LogRecord) -> None:
        """Take one line."""
        cause = getattr(record, "cause", None)
        if cause is None:
            self.unbounded.append(record.getMessage())
        else:
            self._at[cause, getattr(record, "subject", "")].append(self._flap.clock())

    def worst_hours(self) -> Iterator[tuple[Cause, int]]:
        """Yield for each cause and subject the most lines in any hour."""
        for (cause, _), instants in self._at.items():
            ends = (bisect_left(instants, at + HOUR_S) for at in instants)
            yield Cause[cause], max(end - begin for begin, end in enumerate(ends))


@contextmanager
def counted(flap: Flap) -> Iterator[LogCount]:
    """Count what is logged meanwhile, from `info` on; nothing else is told of it."""
    count, root = LogCount(flap), logging.getLogger()
    level, handlers = root.level, root.handlers[:]
    root.handlers[:] = [count]
    root.setLevel(logging.INFO)
    try:
        yield count
    finally:
        root.handlers[:] = handlers
        root.setLevel(level)
