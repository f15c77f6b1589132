"""Keeps what can repeat within 20 log lines an hour: repeats are counted and summed up.

CONTRACT.md, promise 9. The first is told at once, and so is the end. Everything that can be
logged again and again has a `Cause` here, and goes through a `BoundedLog`: the list of causes is
what the proof of this promise runs through.
"""

import logging
from collections import OrderedDict
from collections.abc import Callable, Mapping
from enum import StrEnum

# In any hour: the burst, and what is filled up meanwhile. 6 + 12 = 18 lines.
BURST_LINES = 6
REFILL_S = 300.0
MOST_LINES_AN_HOUR = 20
_MOST_SUBJECTS = 4096  # subjects come from the configuration; this bounds a mistake


class Cause(StrEnum):
    """Everything that can be logged again and again."""

    BROKER_CONNECTION = "the connection to the broker comes and goes"
    BROKER_DENIES = "the broker denies subscriptions or publications"
    BROKER_STALE = "no ping comes back"
    PORT = "the port of a line comes and goes"
    STATION = "a module comes and goes, or is another model"
    SETTINGS = "modes or hold times are not as declared"
    STRAYS = "bytes that the bridge did not ask for"
    UNASKED = "outputs change unasked"
    COMMAND = "commands are refused, or fail"
    UNKNOWN_STATION = "commands to stations that are not configured"
    OWN_ORDER = "max_on, on_loss and covers switch outputs"
    REQUEST = "requests are refused"
    RELOAD = "the configuration is read again"
    MESSAGE = "messages cannot be read, or are too large"
    VERDICTS = "verdicts are dropped"
    DISK = "files cannot be written"
    CLOCK = "the machine was suspended, or its clock was set"


class BoundedLog:
    """Tells a logger what happens, and bounds what repeats. One thread owns it.

    Every key (cause and subject) has its own budget of lines. A subject comes from the
    configuration (a line, a station, a station and a reason), never from a message.
    """

    def __init__(self, logger: logging.Logger, clock: Callable[[], float]) -> None:
        self._logger = logger
        self._clock = clock
        self._keys: OrderedDict[tuple[Cause, str], _Budget] = OrderedDict()

    def __len__(self) -> int:
        return len(self._keys)

    def tell(
        self,
        cause: Cause,
        subject: str,
        level: int,
        text: str,
        extra: Mapping[str, object] | None = None,
    ) -> None:
        """Log `text` now, or count it, and log the latest one as soon as the budget allows."""
        self._take(cause, subject, _Line(level, text, extra, is_end=False))

    def end(
        self,
        cause: Cause,
        subject: str,
        text: str,
        extra: Mapping[str, object] | None = None,
        level: int = logging.INFO,
    ) -> None:
        """Log that it is over, if it was told that it began; later where the budget is spent."""
        budget = self._keys.get((cause, subject))
        if budget is not None and budget.is_on:
            self._take(cause, subject, _Line(level, text, extra, is_end=True))

    def tick(self) -> None:
        """Log what was held back and may be told by now. To be called at least once a minute."""
        now = self._clock()
        for budget in self._keys.values():
            if budget.held is not None and budget.spend(now):
                self._log(budget, budget.held)

    def _take(self, cause: Cause, subject: str, line: "_Line") -> None:
        budget = self._keys.get((cause, subject))
        if budget is None:
            if len(self._keys) >= _MOST_SUBJECTS:
                self._keys.popitem(last=False)
            budget = self._keys[cause, subject] = _Budget(self._clock())
        budget.is_on = not line.is_end
        if budget.spend(self._clock()):
            self._log(budget, line)
        else:
            budget.held = line
            budget.repeats += not line.is_end

    def _log(self, budget: "_Budget", line: "_Line") -> None:
        repeats = budget.repeats - (line is budget.held and not line.is_end)
        more = f" (and {repeats} times more since the last line about it)" if repeats > 0 else ""
        budget.held = None
        budget.repeats = 0
        self._logger.log(line.level, "%s%s", line.text, more, extra=line.extra)


class _Line:
    """What is to be said."""

    __slots__ = ("extra", "is_end", "level", "text")

    def __init__(
        self, level: int, text: str, extra: Mapping[str, object] | None, *, is_end: bool
    ) -> None:
        self.level = level
        self.text = text
        self.extra = extra
        self.is_end = is_end


class _Budget:
    """The lines that one key may still have, and what waits for the next."""

    __slots__ = ("_at", "_left", "held", "is_on", "repeats")

    def __init__(self, now: float) -> None:
        self.held: _Line | None = None
        self.repeats = 0
        self.is_on = False
        self._left = float(BURST_LINES)
        self._at = now

    def spend(self, now: float) -> bool:
        """Take one line from the budget; False where there is none left."""
        self._left = min(float(BURST_LINES), self._left + (now - self._at) / REFILL_S)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
