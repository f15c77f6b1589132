"""Limits log lines that can repeat to 20 an hour for one cause; repeats are counted.

The first line and the end are logged at once (docs/contract.md, promise 9). Everything that can
repeat has a `Cause` and is logged through a `BoundedLog`. The proof of the promise uses the list of
causes, and a test finds log calls that do not use it.
"""

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

# In any hour: 6 lines at once, 12 as the budget refills, and 1 at the end: 19.
BURST_LINES = 6
REFILL_S = 300.0
MOST_LINES_AN_HOUR = 20
MOST_SUBJECTS = 4096  # subjects come from the configuration; this limits the effect of a mistake


class Cause(StrEnum):
    """A cause of log lines that can repeat."""

    BROKER_CONNECTION = "the connection to the broker comes and goes"
    BROKER_DENIES = "the broker denies subscriptions or publications"
    BROKER_STALE = "no ping comes back"
    PORT = "the port of a line comes and goes"
    STATION = "a module comes and goes, or is another model"
    SETTINGS = "modes or hold times are not as declared"
    STRAYS = "bytes that the bridge did not ask for"
    UNASKED = "outputs change unasked"
    MOTOR = "a motor could not be stopped"
    COMMAND = "commands are refused, or fail"
    UNKNOWN_STATION = "commands to stations that are not configured"
    OWN_ORDER = "max_on, on_loss and covers switch outputs"
    REQUEST = "requests are refused"
    RELOAD = "the configuration is read again"
    LEFTOVERS = "what is not configured any more is cleared from the broker"
    MESSAGE = "messages cannot be read, or are too large"
    VERDICTS = "verdicts are dropped"
    DISK = "files cannot be written"
    CLOCK = "the machine was suspended"
    PANEL = "the panel in the browser cannot listen, or a request to it fails"


@dataclass(slots=True)
class _Line:
    """A line that is to be logged; `amount` is the number for its text."""

    logger: logging.Logger
    level: int
    text: str
    extra: Mapping[str, object]
    amount: int
    error: BaseException | None
    is_end: bool

    def log(self) -> None:
        self.logger.log(self.level, "%s", self.text, exc_info=self.error, extra=self.extra)


class Budgets:
    """The budgets of all causes and subjects, for the whole process.

    Any thread may use it. A reload starts new threads; the budgets continue.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()  # held briefly, never while a line is written
        self._keys: OrderedDict[tuple[Cause, str], _Budget] = OrderedDict()
        self._holding: set[tuple[Cause, str]] = set()

    def __len__(self) -> int:
        return len(self._keys)

    def take(self, cause: Cause, subject: str, line: _Line, *, always: bool) -> None:
        """Log the line, or hold it back.

        Without `always`, a line that equals the held one is dropped.
        """
        now = self._clock()
        with self._lock:
            key = self._key_of(cause, subject, now)
            budget = self._keys.get(key)
            is_on = budget is not None and budget.is_on
            if not always and is_on is not line.is_end:
                return
            if budget is None:
                budget = self._keys[key] = _Budget(now)
            self._keys.move_to_end(key)
            self._holding.add(key)
            budget.hold(line)
            due = self._release(key, now)
        _log_all([due])

    def tick(self) -> None:
        """Log the lines that the budgets allow by now. To be called at least once a minute."""
        if self._holding:
            now = self._clock()
            with self._lock:
                due = [self._release(key, now) for key in list(self._holding)]
            _log_all(due)

    def close(self) -> None:
        """Log every line that is still held back, at the end of the process."""
        with self._lock:
            due = [self._keys[key].take_held() for key in self._holding]
            self._holding.clear()
        _log_all(due)

    def _release(self, key: tuple[Cause, str], now: float) -> _Line | None:
        budget = self._keys[key]
        if not budget.spend(now):
            return None
        self._holding.discard(key)
        return budget.take_held()

    def _key_of(self, cause: Cause, subject: str, now: float) -> tuple[Cause, str]:
        """Return the key of a budget; with too many subjects, the later ones share one."""
        key = (cause, subject)
        if key in self._keys or len(self._keys) < MOST_SUBJECTS:
            return key
        eldest = next(iter(self._keys))
        if eldest not in self._holding and self._keys[eldest].is_idle(now):
            del self._keys[eldest]
            return key
        return (cause, "")


def _log_all(lines: Iterable[_Line | None]) -> None:
    for line in lines:
        if line is not None:
            line.log()


class BoundedLog:
    """Passes lines to a logger and limits repeats.

    Each subject of each cause has its own budget. A subject comes from the configuration (a line, a
    station, a station and a reason), never from a message.
    """

    def __init__(
        self, logger: logging.Logger, clock: Callable[[], float], budgets: Budgets | None = None
    ) -> None:
        """Create it; `budgets` are those of the process; without them it has its own."""
        self._logger = logger
        self._budgets = Budgets(clock) if budgets is None else budgets

    def tell(
        self,
        cause: Cause,
        subject: str,
        level: int,
        text: str,
        extra: Mapping[str, object] | None = None,
        *,
        once: bool = False,
        amount: int = 0,
        error: BaseException | None = None,
    ) -> None:
        """Log `text` now; or count it, and log the latest text when the budget allows.

        With `once` it is not logged again before `end` was called. `amount` replaces `{amount}` in
        the text, added to the amounts of the lines that were counted. `error` is logged with its
        traceback if the line is logged at once.
        """
        marked = _marked(cause, subject, extra)
        line = _Line(self._logger, level, text, marked, amount, error, is_end=False)
        self._budgets.take(cause, subject, line, always=not once)

    def end(
        self,
        cause: Cause,
        subject: str,
        text: str,
        extra: Mapping[str, object] | None = None,
        level: int = logging.INFO,
        *,
        always: bool = False,
    ) -> None:
        """Log the end of something whose start was logged; later if the budget is used up.

        With `always` it is logged even if no start was logged.
        """
        marked = _marked(cause, subject, extra)
        line = _Line(self._logger, level, text, marked, 0, None, is_end=True)
        self._budgets.take(cause, subject, line, always=always)

    def tick(self) -> None:
        """Log the lines that the budgets allow by now. To be called at least once a minute."""
        self._budgets.tick()


def _marked(cause: Cause, subject: str, extra: Mapping[str, object] | None) -> Mapping[str, object]:
    """Return `extra` with cause and subject: a counter of lines need not read their text."""
    return {**(extra or {}), "cause": cause.name, "subject": subject}


class _Budget:
    """The budget of one key, and the line that waits."""

    __slots__ = ("_amount", "_at", "_held", "_left", "_untold", "is_on")

    def __init__(self, now: float) -> None:
        self.is_on = False
        self._held: _Line | None = None
        self._untold = 0
        self._amount = 0
        self._left = float(BURST_LINES)
        self._at = now

    def hold(self, line: _Line) -> None:
        """Keep the line in place of the one that waits."""
        if self._held is not None:
            line.error = None  # a traceback keeps objects alive
        self.is_on = not line.is_end
        self._untold += not line.is_end
        self._amount += line.amount
        self._held = line

    def take_held(self) -> _Line | None:
        """Return the line that waits, with the number of lines since the last one."""
        line = self._held
        if line is None:
            return None
        repeats = self._untold - (not line.is_end)
        more = f" (and {repeats} times more since the last line about it)" if repeats > 0 else ""
        if self._amount:
            line.text = line.text.replace("{amount}", str(self._amount))
        line.text += more
        self._held, self._untold, self._amount = None, 0, 0
        return line

    def is_idle(self, now: float) -> bool:
        """Return whether the budget is full: to forget it then changes nothing."""
        return not self.is_on and self._left + (now - self._at) / REFILL_S >= BURST_LINES

    def spend(self, now: float) -> bool:
        """Take one line from the budget; return False if it is used up."""
        self._left = min(float(BURST_LINES), self._left + (now - self._at) / REFILL_S)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
