"""The commands that wait for a line: the main thread puts them in, the line takes them out."""

import queue
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from bridge.config.schema import RuleConfig
from bridge.line.errand import EndErrand, Errand, LineTask, Trace
from bridge.model import AnyCommand, CoverCommand, Orders, SettingCommand

# The time after which a command expires, so the commands of a scene are carried out together.
BURST_S = 2.0
# At 9600 baud this many take half a second: a command for another station still has time.
_MOST_IN_A_ROW = 4
_ONE_MORE_S = 0.001  # shorter than any exchange


@dataclass(frozen=True, slots=True)
class _Stop:
    """The line was asked to end at this instant."""

    asked_at: float


@dataclass(frozen=True, slots=True)
class _BrokerSeen:
    """The broker went away at this instant, or came back (None)."""

    away_since: float | None
    done: Orders


@dataclass(frozen=True, slots=True)
class _Rules:
    """The rules of inputs of this line that are switched on."""

    active: tuple[RuleConfig, ...]


Item = AnyCommand | LineTask | _BrokerSeen | _Rules | _Stop


class WaitingCommands:
    """A queue whose end may be overtaken.

    Only `put`, `broker`, `rules` and `stop` are for other threads.

    `is_absolute` tells whether a command merely sets outputs to given values: each pulse and each
    toggle means something of its own, so they neither overtake nor are overtaken. `overtaken` is
    given each command that need not be sent any more. `may_stall` tells whether a command is for a
    module that just now does not answer. `in_one_frame` tells which of some outputs one frame may
    write together with those of a command; 0: it goes alone. `follow_rules` is given the rules that
    are to be followed.

    Attributes:
        stop_asked_at: When `stop` was called: nothing is waited for any more; None: it was not.
        broker_away_since: What `broker` said last.
        done_in_loss: Orders of this loss that were made before this worker began.
        errands: The oldest first; who does them takes them out.
        unwanted_errand: The id of one that is to end.
        trace: The newest that came; who sees to it takes it out.
    """

    def __init__(
        self,
        is_absolute: Callable[[AnyCommand], bool],
        overtaken: Callable[[AnyCommand], None],
        may_stall: Callable[[AnyCommand], bool],
        *,
        in_one_frame: Callable[[AnyCommand, int], int] = lambda _command, _outputs: 0,
        follow_rules: Callable[[Sequence[RuleConfig]], None] = lambda _: None,
        inbox: queue.SimpleQueue[Item] | None = None,
    ) -> None:
        self.stop_asked_at: float | None = None
        self.broker_away_since: float | None = None
        self.done_in_loss: Orders = frozenset()
        self.errands: deque[Errand] = deque()
        self.unwanted_errand: int | None = None
        self.trace: Trace | None = None
        self._inbox: queue.SimpleQueue[Item] = queue.SimpleQueue() if inbox is None else inbox
        self._waiting: deque[AnyCommand] = deque()
        self._is_absolute = is_absolute
        self._overtaken = overtaken
        self._may_stall = may_stall
        self._in_one_frame = in_one_frame
        self._follow_rules = follow_rules
        self._served = ""  # the station of the last command
        self._in_a_row = 0

    def put(self, item: AnyCommand | LineTask) -> None:
        """Add a command, errand or trace; wake the worker."""
        self._inbox.put(item)

    def broker(self, away_since: float | None, done: Orders = frozenset()) -> None:
        """Record since when the broker is away (None: present); wake the worker."""
        self._inbox.put(_BrokerSeen(away_since, done))

    def rules(self, active: tuple[RuleConfig, ...]) -> None:
        """Give the rules that are to be followed from now on; wake the worker."""
        self._inbox.put(_Rules(active))

    def stop(self, now: float) -> None:
        """Ask the worker to end; wake it."""
        self._inbox.put(_Stop(now))

    @property
    def stopping(self) -> bool:
        """Return whether `stop` was called."""
        return self.stop_asked_at is not None

    @property
    def asked_besides(self) -> bool:
        """Return whether there is a request that is not a command."""
        return self.trace is not None or bool(self.errands)

    def __len__(self) -> int:
        return len(self._waiting)

    def pop(self) -> AnyCommand:
        """Take out the command that comes next, without those that could go with it."""
        chosen = self.choose()[:1]
        self.remove(chosen)
        return chosen[0]

    def choose(self) -> Sequence[AnyCommand]:
        """Return the oldest command, with those that go in one write with it.

        Those that may stall come only when there is no other. A station that had several in a row
        lets another pass: a flood of one holds up no other station (docs/failures.md A15).
        """
        ready = [c for c in self._waiting if not self._may_stall(c)] or self._waiting
        chosen = ready[0]
        if chosen.station_id == self._served and self._in_a_row >= _MOST_IN_A_ROW:
            chosen = next((c for c in ready if c.station_id != self._served), chosen)
        return self._together(chosen)

    def remove(self, chosen: Sequence[AnyCommand]) -> None:
        """Take these out: they are carried out now, as one."""
        station_id = chosen[0].station_id
        self._in_a_row = self._in_a_row + 1 if station_id == self._served else 1
        self._served = station_id
        for command in chosen:
            self._waiting.remove(command)

    def _together(self, first: AnyCommand) -> Sequence[AnyCommand]:
        """Return `first`, the oldest of its station, and what goes in one write with it.

        What goes alone keeps its place in the order: what came after it stays behind it. So does
        what names an output that one before it names.
        """
        found, outputs = list[AnyCommand](), 0
        for command in self._waiting:
            if command.station_id != first.station_id:
                continue
            if command.mask & outputs or not self._in_one_frame(command, command.mask):
                break
            found.append(command)
            outputs |= command.mask
        if not found:
            return [first]
        written = self._in_one_frame(first, outputs)
        return [command for command in found if not command.mask & ~written]

    def take_late(self, now: float) -> list[AnyCommand]:
        """Remove and return the commands that are too late to send."""
        late = [command for command in self._waiting if now > command.deadline]
        for command in late:
            self._waiting.remove(command)
        return late

    def is_urgent(self, now: float) -> bool:
        """Return whether a value for an output has waited for a quarter of its time.

        Of such commands only the newest waits, so there is no flood of them. Three quarters are
        left for the commands before it, and for replies that do not come.
        """
        return any(
            3 * (now - c.arrived) > c.deadline - now and self._is_absolute(c) for c in self._waiting
        )

    def collect(self, wait_s: float = 0.0) -> bool:
        """Move in the queued items; wait up to `wait_s` seconds for the first.

        Return False if there was none.
        """
        if wait_s <= 0 and self._inbox.empty():
            return False  # usually the queue is empty between two polls
        came = False
        with suppress(queue.Empty):
            item = self._inbox.get(timeout=wait_s) if wait_s > 0 else self._inbox.get_nowait()
            came = True
            while True:
                self._take(item)
                item = self._inbox.get_nowait()
        return came

    def _take(self, item: Item) -> None:
        match item:
            case _BrokerSeen(away_since, done):
                self.broker_away_since, self.done_in_loss = away_since, done
            case _Rules(active):
                self._follow_rules(active)
            case _Stop(asked_at):
                self.stop_asked_at = asked_at
            case Errand():
                self.errands.append(item)
            case EndErrand(errand_id):
                self.unwanted_errand = errand_id
            case Trace():
                self.trace = item
            case _:
                self._overtake(item)
                self._waiting.append(item)

    def newer_than(self, command: AnyCommand) -> bool:
        """Return whether a newer command names an output of `command`."""
        self.collect()
        return any(
            c.station_id == command.station_id and c.mask & command.mask for c in self._waiting
        )

    def _overtake(self, newer: AnyCommand) -> None:
        if isinstance(newer, SettingCommand | CoverCommand):
            self._overtake_same(newer)
            return
        if not self._is_absolute(newer):
            return
        named = newer.mask  # the outputs of which something newer is said
        for older in list(reversed(self._waiting)):
            if older.station_id != newer.station_id:
                continue
            if not self._is_absolute(older):
                named &= ~older.mask  # what came before it is part of what it will do
            elif not older.mask & ~named:
                self._waiting.remove(older)
                self._overtaken(older)
            else:
                named |= older.mask

    def _overtake_same(self, newer: SettingCommand | CoverCommand) -> None:
        """Keep only the last value: a slider sends many, and an EEPROM wears out."""
        for older in list(reversed(self._waiting)):
            if older.station_id != newer.station_id or not older.mask & newer.mask:
                continue
            if type(older) is not type(newer):
                return  # commands before one to the output were meant to come before it
            if older.target == newer.target:
                self._waiting.remove(older)
                self._overtaken(older)


class TimeShare:
    """Limits the time of commands on a line: a burst, and half of the time in the long run.

    So a flood of commands does not stop the reads. An urgent command waits for one read at most:
    else it would expire. Time is an argument (`bridge.clock.boot_s`).
    """

    __slots__ = ("_left_s", "_since")

    def __init__(self, now: float) -> None:
        self._left_s = BURST_S
        self._since = now

    def begin(self, now: float, *, urgent: bool = False) -> None:
        """Begin a time of commands; the reads since `end` earned time for it.

        If it is `urgent`, there is time for one command in any case.
        """
        self._left_s = min(self._left_s + now - self._since, BURST_S)
        if urgent:
            self._left_s = max(self._left_s, _ONE_MORE_S)
        self._since = now

    def is_left(self, now: float) -> bool:
        """Return whether one more command may begin."""
        return now - self._since < self._left_s

    def end(self, now: float) -> None:
        """Reads come next. What took so long that it was no command (a suspend) is not paid for."""
        self._left_s = max(self._left_s - (now - self._since), -BURST_S)
        self._since = now

    def fill(self) -> None:
        """Restore the full burst: no other work waits."""
        self._left_s = BURST_S
