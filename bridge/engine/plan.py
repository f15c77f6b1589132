"""Decides what is read next on a line. Time comes in as an argument: monotonic seconds."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from bridge.config.schema import LineConfig
from bridge.engine.presence import Kind, Presence


@dataclass(frozen=True, slots=True)
class Poll:
    """One read of one station: the plan's word to the line worker."""

    station: int
    kind: Kind


@dataclass(frozen=True, slots=True)
class Idle:
    """Nothing is due before `until`."""

    until: float


def polls_of(line: LineConfig) -> tuple[Poll, ...]:
    """Inputs and outputs of every station of a line, in the file's order."""
    polls = []
    for station in line.stations:
        if station.model.inputs:
            polls.append(Poll(station.address, Kind.INPUTS))
        polls.append(Poll(station.address, Kind.OUTPUTS))
    return tuple(polls)


class PollPlan(Protocol):
    """All that the line worker asks of a plan: what is next, and to look again at once."""

    def next(self, now: float) -> Poll | Idle:
        """The read that is due now, or how long nothing is."""
        ...

    def again(self, poll: Poll) -> None:
        """This read is wanted once more before anything else (a change to be confirmed)."""
        ...

    def bound_s(self, station: int, cost_s: Callable[[Poll], float]) -> float:
        """The longest time between two reads of a channel of `station` while all answer."""
        ...


class RoundRobin:
    """Reads inputs and outputs of every online station in turn.

    Stations that stopped answering are risky: each try costs a time-out. So a risky read never
    follows another while a healthy one is due, and of the stations that are offline one is
    probed a round.
    """

    def __init__(self, polls: Sequence[Poll], presences: Mapping[int, Presence]) -> None:
        self._polls = tuple(polls)
        self._presences = presences
        self._position = 0
        self._again: deque[Poll] = deque()
        self._probed_this_round = False
        self._risky_before = False

    def next(self, now: float) -> Poll | Idle:
        """A change to confirm first, then risky and healthy reads by turns."""
        while self._again:
            poll = self._again.popleft()
            if self._presences[poll.station].online:
                return poll
        healthy = self._next_healthy()
        if not self._risky_before or healthy is None:
            risky = self._retry(now) or self._probe(now, alone=healthy is None)
            if risky is not None:
                self._risky_before = True
                return risky
        self._risky_before = False
        if healthy is None:
            return Idle(self._next_risky_at())
        self._advance_past(healthy)
        return self._polls[healthy]

    def again(self, poll: Poll) -> None:
        """Reads it once more before the round goes on."""
        self._again.append(poll)

    def bound_s(self, station: int, cost_s: Callable[[Poll], float]) -> float:
        """One round of all stations, and this station's own first read of the next."""
        own = max(cost_s(poll) for poll in self._polls if poll.station == station)
        return sum(cost_s(poll) for poll in self._polls) + own

    def _is_healthy(self, poll: Poll) -> bool:
        presence = self._presences[poll.station]
        return presence.online and not presence.suspect(poll.kind)

    def _next_healthy(self) -> int | None:
        count = len(self._polls)
        for step in range(count):
            index = (self._position + step) % count
            if self._is_healthy(self._polls[index]):
                return index
        return None

    def _advance_past(self, index: int) -> None:
        if index < self._position or index == len(self._polls) - 1:
            self._probed_this_round = False
        self._position = (index + 1) % len(self._polls)

    def _retry(self, now: float) -> Poll | None:
        """The suspect read that is longest overdue, if any is due."""
        best: Poll | None = None
        best_at = now
        for poll in self._polls:
            presence = self._presences[poll.station]
            if presence.online and presence.suspect(poll.kind):
                at = presence.retry_at(poll.kind)
                if at <= best_at:
                    best, best_at = poll, at
        return best

    def _probe(self, now: float, *, alone: bool) -> Poll | None:
        """The offline station whose probe is longest overdue: one a round."""
        if self._probed_this_round and not alone:
            return None
        due = [
            (presence.probe_at, station)
            for station, presence in self._presences.items()
            if not presence.online and presence.probe_at <= now
        ]
        if not due:
            return None
        self._probed_this_round = True
        return Poll(min(due)[1], Kind.CONTACT)

    def _next_risky_at(self) -> float:
        """When no station is healthy, every one is either offline or suspect."""
        times = [p.probe_at for p in self._presences.values() if not p.online]
        for poll in self._polls:
            presence = self._presences[poll.station]
            if presence.online and presence.suspect(poll.kind):
                times.append(presence.retry_at(poll.kind))
        return min(times)
