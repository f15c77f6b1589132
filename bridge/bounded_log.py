"""Keeps what can repeat within 20 log lines an hour: repeats are counted and summed up.

docs/contract.md, promise 9. The first is told at once, and so is the end. Everything that can be
logged again and again has a `Cause` here, and goes through a `BoundedLog`: the list of causes is
what the proof of this promise runs through, and a test looks for what goes past it.
"""

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

# In any hour: the burst, and what is filled up meanwhile. 6 + 12 = 18 lines; 1 more at the end.
BURST_LINES = 6
REFILL_S = 300.0
MOST_LINES_AN_HOUR = 20
MOST_SUBJECTS = 4096  # subjects come from the configuration; this bounds a mistake


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


@dataclass(slots=True)
class _Line:
    """Describe what is to be said, and how much of it there is (`amount`)."""

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
    """Describe how many lines each cause of each subject may still have, for the whole process.

    Any thread may call it: a reload starts threads anew, and what they may log goes on.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()  # held for moments, and never while a line is written
        self._keys: OrderedDict[tuple[Cause, str], _Budget] = OrderedDict()
        self._holding: set[tuple[Cause, str]] = set()

    def __len__(self) -> int:
        return len(self._keys)

    def take(self, cause: Cause, subject: str, line: _Line, *, always: bool) -> None:
        """Log the line, or hold it back. What changes nothing is dropped, unless `always`."""
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
        """Log what was held back and may be told by now. To be called at least once a minute."""
        if self._holding:
            now = self._clock()
            with self._lock:
                due = [self._release(key, now) for key in list(self._holding)]
            _log_all(due)

    def close(self) -> None:
        """Log what is still held back: there will be no other time."""
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
        """Return where the subjects are too many those that come last share one budget."""
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
    """Tells a logger what happens, and bounds what repeats.

    Every cause of every subject has its own budget of lines. A subject comes from the
    configuration (a line, a station, a station and a reason), never from a message.
    """

    def __init__(
        self,
        logger: logging.Logger,
        clock: Callable[[], float],
        budgets: Budgets | None = None,
    ) -> None:
        """Args: `budgets` are those of the process; without them this log has its own."""
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
        """Log `text` now, or count it, and log the latest one as soon as the budget allows.

        With `once` it is not told again before its end was told. `amount` takes the place of
        `{amount}` in the text, together with the amounts of those that were counted before it.
        `error` is logged with its trace where the line is logged at once.
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
        """Log that it is over, if it was told that it began; later where the budget is spent.

        With `always` it is logged also where nothing was told: it begins well.
        """
        marked = _marked(cause, subject, extra)
        line = _Line(self._logger, level, text, marked, 0, None, is_end=True)
        self._budgets.take(cause, subject, line, always=always)

    def tick(self) -> None:
        """Log what was held back and may be told by now. To be called at least once a minute."""
        self._budgets.tick()


def _marked(cause: Cause, subject: str, extra: Mapping[str, object] | None) -> Mapping[str, object]:
    """Records say what they are about: who counts them needs not guess from the text."""
    return {**(extra or {}), "cause": cause.name, "subject": subject}


class _Budget:
    """The lines that one key may still have, and what waits for the next."""

    __slots__ = ("_amount", "_at", "_held", "_left", "_untold", "is_on")

    def __init__(self, now: float) -> None:
        self.is_on = False
        self._held: _Line | None = None
        self._untold = 0
        self._amount = 0
        self._left = float(BURST_LINES)
        self._at = now

    def hold(self, line: _Line) -> None:
        """Take the line in place of what waits."""
        if self._held is not None:
            line.error = None  # its trace keeps objects alive
        self.is_on = not line.is_end
        self._untold += not line.is_end
        self._amount += line.amount
        self._held = line

    def take_held(self) -> _Line | None:
        """Return what waits, with what was counted since the last line."""
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
        """Return whether it lacks no line: to forget it changes nothing."""
        return not self.is_on and self._left + (now - self._at) / REFILL_S >= BURST_LINES

    def spend(self, now: float) -> bool:
        """Take one line from the budget; False where there is none left."""
        self._left = min(float(BURST_LINES), self._left + (now - self._at) / REFILL_S)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
