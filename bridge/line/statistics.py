"""Figures of a line and its stations: bounded in memory, and fast to count.

Only the thread of the line uses it; frozen values leave it. Time is an argument.
"""

from collections.abc import Callable, Iterator, Mapping

from bridge.config.schema import LineConfig
from bridge.errors import BadReplyError, ExchangeError, NoReplyError, RefusedError
from bridge.line.forecast import forecast
from bridge.line.plan.streams import Poll, streams_of
from bridge.line.rules.histogram import Histogram
from bridge.line.rules.presence import Kind, Presence
from bridge.model import (
    NOTHING_LEARNED,
    ExchangeCounts,
    Learned,
    LineMeasured,
    StationMeasured,
)

EVERY_S = 60.0
FIRST_AFTER_S = 5.0  # so that a person who sets up a line soon sees the first figures


class StationStatistics:
    """The figures of one station."""

    __slots__ = (
        "_bad",
        "_good",
        "_last_error",
        "_last_seen",
        "_polls",
        "_read_at",
        "_refused",
        "_replies",
        "_silent",
    )

    def __init__(self) -> None:
        self._good = 0
        self._silent = 0
        self._bad = 0
        self._refused = 0
        self._last_error: str | None = None
        self._last_seen: float | None = None
        self._read_at: dict[Kind, float] = {}
        self._polls = Histogram()
        self._replies = Histogram()

    @property
    def counts(self) -> ExchangeCounts:
        """Return the results of its exchanges since the start."""
        return ExchangeCounts(self._good, self._silent, self._bad, self._refused)

    def replied(self, reply_s: float, now: float) -> None:
        """Count a good reply."""
        self._good += 1
        self._last_seen = now
        self._replies.add(reply_s)

    def failed(self, error: ExchangeError, now: float) -> None:
        """Count a failed exchange."""
        match error:
            case RefusedError():  # a valid answer: the module is there
                self._refused += 1
                self._last_seen = now
                return
            case NoReplyError():
                self._silent += 1
            case BadReplyError():
                self._bad += 1
        self._last_error = str(error)

    def was_read(self, kind: Kind, now: float) -> None:
        """Count a read of its inputs, or of its outputs."""
        before = self._read_at.get(kind)
        self._read_at[kind] = now
        if before is not None:
            self._polls.add(now - before)

    def gone(self) -> None:
        """Record that it is offline: the time of its absence is not a poll time."""
        self._read_at.clear()

    def measured(
        self, station_id: str, bound_s: float, learned: Learned, now: float
    ) -> StationMeasured:
        """Return the figures of the period that ends now; begin the next one."""
        open_s = [now - at for at in self._read_at.values()]
        measured = StationMeasured(
            station_id=station_id,
            poll=self._polls.spread(),
            reply=self._replies.spread(),
            bound_s=bound_s,
            age_s=max([self._polls.longest_s, *open_s]) if open_s else None,
            counts=self.counts,
            last_error=self._last_error,
            last_seen=self._last_seen,
            learned=learned,
        )
        self._polls.clear()
        self._replies.clear()
        return measured


class Rounds:
    """Measures cycles: the time in which everything in the rotation that answers was read once."""

    __slots__ = ("_began", "_pending", "_polls", "_presences", "cycles")

    def __init__(self, polls: tuple[Poll, ...], presences: Mapping[int, Presence]) -> None:
        self.cycles = Histogram()
        self._polls = polls
        self._presences = presences
        self._pending: set[Poll] = set()
        self._began: float | None = None

    def was_read(self, poll: Poll, now: float) -> None:
        """Count an answered poll."""
        self._pending.discard(poll)
        if self._pending:
            return
        if self._began is not None:
            self.cycles.add(now - self._began)
        self._began = now
        self._pending = {p for p in self._polls if self._is_healthy(p.address)}

    def missed(self, address: int) -> None:
        """Record that a station did not answer: the cycle continues without it."""
        self._pending = {poll for poll in self._pending if poll.address != address}

    def restart(self) -> None:
        """Begin again: the port was lost."""
        self._pending.clear()
        self._began = None

    def _is_healthy(self, address: int) -> bool:
        presence = self._presences[address]
        return presence.online and presence.suspect is None


class LineStatistics:
    """The figures of one line and its stations.

    Attributes:
        line: Its id.
        stations: By address.
        due_at: When the next report is due.
        busy_s: The time of all exchanges in this period.
        unsolicited_bytes: Bytes that were not requested.
        learned: Tells what the bus of the open port learned of a station.
    """

    def __init__(self, config: LineConfig, presences: Mapping[int, Presence], now: float) -> None:
        self.line = config.id
        self.stations = {
            station_config.address: StationStatistics() for station_config in config.stations
        }
        self.due_at = now + FIRST_AFTER_S
        self.unsolicited_bytes = 0
        self.learned: Callable[[int], Learned] = lambda _address: NOTHING_LEARNED
        self._config = config
        self._bound_s = forecast(config).bound_s
        self._rounds = Rounds(streams_of(config).steady, presences)
        self.busy_s = 0.0
        self._since = now

    def was_read(self, poll: Poll, now: float) -> None:
        """Count an answered poll."""
        self.stations[poll.address].was_read(poll.kind, now)
        self._rounds.was_read(poll, now)

    def missed(self, address: int) -> None:
        """Count an unanswered poll."""
        self._rounds.missed(address)

    def gone(self, address: int) -> None:
        """Record that a station is offline."""
        self.stations[address].gone()
        self._rounds.missed(address)

    def lost(self) -> None:
        """Record that the port is gone, and all stations with it."""
        for station in self.stations.values():
            station.gone()
        self._rounds.restart()

    def report(self, now: float) -> Iterator[LineMeasured | StationMeasured]:
        """Yield the figures of the period that ends now, line first; begin the next period."""
        yield self._measured(now)
        for config in self._config.stations:
            statistics = self.stations[config.address]
            learned = self.learned(config.address)
            yield statistics.measured(config.id, self._bound_s[config.id], learned, now)
        self._rounds.cycles.clear()
        self.busy_s = 0.0
        self._since = now
        self.due_at = now + EVERY_S

    def _measured(self, now: float) -> LineMeasured:
        counts = [station.counts for station in self.stations.values()]
        return LineMeasured(
            line=self._config.id,
            cycle=self._rounds.cycles.spread(),
            utilisation=min(self.busy_s / (now - self._since), 1.0) if now > self._since else 0.0,
            counts=ExchangeCounts(
                good=sum(count.good for count in counts),
                silent=sum(count.silent for count in counts),
                bad=sum(count.bad for count in counts),
                refused=sum(count.refused for count in counts),
            ),
            unsolicited_bytes=self.unsolicited_bytes,
        )
