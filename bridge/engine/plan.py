"""Decides what is read next on a line. Time comes in as an argument: monotonic seconds."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
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

    A station that stopped answering costs a time-out each time that it is asked. So after such
    a risky read, and after any read that was not answered, comes a healthy one if there is one;
    and of the stations that are offline one a round is asked in vain.
    """

    def __init__(self, polls: Sequence[Poll], presences: Mapping[int, Presence]) -> None:
        self._polls = tuple(polls)
        self._presences = presences
        self._round = deque(polls)  # the read that was made last stands last
        self._again: Poll | None = None
        self._last: Poll | None = None
        self._last_was_risky = False
        self._last_was_again = False
        self._probed: int | None = None
        self._reads_since_probe = 0

    def next(self, now: float) -> Poll | Idle:
        """A change to confirm first, then risky and healthy reads by turns."""
        again, self._again = self._again, None
        self._last_was_again = again is not None
        if again is not None and self._is_healthy(again.station):
            return self._made(again, risky=False)
        healthy = self._first_healthy()
        if healthy is None or not self._is_healthys_turn():
            risky = self._retry(now) or self._probe(now, alone=healthy is None)
            if risky is not None:
                return self._made(risky, risky=True)
        if healthy is None:
            return Idle(self._next_risky_at())
        self._reads_since_probe += 1
        self._round.remove(healthy)
        self._round.append(healthy)
        return self._made(healthy, risky=False)

    def again(self, poll: Poll) -> None:
        """Reads it once more before the round goes on.

        Only once: channels that change faster than they can be read must not hold up the line.
        """
        if not self._last_was_again:
            self._again = poll

    def bound_s(self, station: int, cost_s: Callable[[Poll], float]) -> float:
        """One round of all stations, and this station's own first read of the next."""
        own = max(cost_s(poll) for poll in self._polls if poll.station == station)
        return sum(cost_s(poll) for poll in self._polls) + own

    def _made(self, poll: Poll, *, risky: bool) -> Poll:
        self._last, self._last_was_risky = poll, risky
        return poll

    def _is_healthy(self, station: int) -> bool:
        presence = self._presences[station]
        return presence.online and presence.suspect is None

    def _is_healthys_turn(self) -> bool:
        if self._last is None:
            return False
        return self._last_was_risky or not self._is_healthy(self._last.station)

    def _first_healthy(self) -> Poll | None:
        """Of the healthy reads, the one that was made the longest ago."""
        return next((poll for poll in self._round if self._is_healthy(poll.station)), None)

    def _retry(self, now: float) -> Poll | None:
        """The suspect read that is longest overdue, if any is due."""
        due = [(at, poll) for at, poll in self._retries() if at <= now]
        return min(due, key=lambda item: item[0])[1] if due else None

    def _retries(self) -> Iterator[tuple[float, Poll]]:
        for station, presence in self._presences.items():
            if presence.suspect is not None:
                yield presence.retry_at, Poll(station, presence.suspect)

    def _probe(self, now: float, *, alone: bool) -> Poll | None:
        """The offline station whose probe is longest overdue: one a round in vain."""
        if not alone and not self._round_is_over():
            return None
        due = [
            (presence.probe_at, station)
            for station, presence in self._presences.items()
            if not presence.online and presence.probe_at <= now
        ]
        if not due:
            return None
        self._reads_since_probe = 0
        self._probed = min(due)[1]
        return Poll(self._probed, Kind.CONTACT)

    def _round_is_over(self) -> bool:
        """Whether each healthy read was made since a probe was in vain."""
        if self._probed is None or self._presences[self._probed].online:
            return True
        return self._reads_since_probe >= sum(self._is_healthy(p.station) for p in self._polls)

    def _next_risky_at(self) -> float:
        """When no station is healthy, every one is either offline or suspect."""
        probes = [p.probe_at for p in self._presences.values() if not p.online]
        return min([*probes, *(at for at, _ in self._retries())])
