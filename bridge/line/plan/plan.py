"""Decides what is read next on a line. Time is an argument (`bridge.clock.boot_s`)."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from bridge.line.plan.rotation import IsHealthy, Rotation
from bridge.line.plan.streams import SETTINGS_S, Poll, Streams
from bridge.line.plan.sweep import Sweep
from bridge.line.rules.presence import Kind, Presence

_RETRIES_IN_A_ROW = 3
VAIN_SHARE = 0.1  # of the time of a line that others use: docs/contract.md, promise 7
_LONGEST_REST_S = 10.0


@dataclass(frozen=True, slots=True)
class Idle:
    """Nothing is due before `until`."""

    until: float


class PollPlan(Protocol):
    """The interface of a plan for the line worker."""

    def next(self, now: float, waiting: Collection[int] = ()) -> Poll | Idle:
        """Return the read that is due now, or until when none is due.

        Values of `waiting` stations cannot be read yet: while others can, these come first.
        """

    def again(self, poll: Poll) -> None:
        """Request this read once more before others: its change has to be confirmed."""

    def changed(self, poll: Poll) -> None:
        """Request this read again soon: it found a change."""

    def appoint(self, poll: Poll, at: float) -> None:
        """Request this read once at an instant: then a pulse will have ended."""

    def probed_in_vain(self, took_s: float, now: float) -> None:
        """Record for how long a probe without an answer kept the others waiting, up to now."""


class WirePlan:
    """Uses the time on the wire for what can have changed: see `streams`, `rotation`, `sweep`.

    Between two reads of the sweep or by appointment comes one of the rotation. Settings come when
    they are due, once a minute each. A station that stopped answering costs a time-out each time it
    is asked. So after such a risky read, and after any unanswered read, comes a read of a healthy
    station if there is one. Only one offline station is probed in a cycle, and all probes in vain
    take a tenth of the time: those of the first round excepted.
    """

    def __init__(self, streams: Streams, presences: Mapping[int, Presence]) -> None:
        self._polls = streams.steady + streams.swept
        self._presences = presences
        self._rotation = Rotation(streams)
        self._sweep = Sweep(streams.swept, streams.sweep_s)
        self._settings = Sweep(streams.settings, SETTINGS_S)
        self._again: Poll | None = None
        self._last: Poll | None = None
        self._last_was_risky = False
        self._last_was_again = False
        self._last_was_swept = False
        self._last_was_settings = False
        self._probed: int | None = None
        self._reads_since_probe = 0
        self._retries_in_a_row = 0
        self._probe_from = 0.0

    def next(self, now: float, waiting: Collection[int] = ()) -> Poll | Idle:
        """Return a change to confirm first, then risky and healthy reads in turn."""
        again, self._again = self._again, None
        self._last_was_again = again is not None
        if again is not None and self._is_healthy(again.address):
            return self._made(again, risky=False)
        alone = not any(map(self._is_healthy, self._presences))
        if alone or not self._is_healthys_turn():
            risky = self._risky(now, alone=alone)
            if risky is not None:
                return self._made(risky, risky=True)
        healthy = None if alone else self._healthy(now, waiting)
        if healthy is None:
            return Idle(self._next_risky_at())
        self._reads_since_probe += healthy.kind is not Kind.SETTINGS
        return self._made(healthy, risky=False)

    def again(self, poll: Poll) -> None:
        """Request a second read before the others, but only once.

        Channels that change faster than they can be read must not hold up the line.
        """
        if not self._last_was_again:
            self._again = poll

    def changed(self, poll: Poll) -> None:
        """See `PollPlan`."""
        self._rotation.changed(poll)

    def appoint(self, poll: Poll, at: float) -> None:
        """See `PollPlan`."""
        sweep = self._settings if poll.kind is Kind.SETTINGS else self._sweep
        sweep.appoint(poll, at)

    def probed_in_vain(self, took_s: float, now: float) -> None:
        """See `PollPlan`."""
        # A module that answers in part makes a contact long: others are not probed later for it.
        self._probe_from = now + min(took_s * (1 / VAIN_SHARE - 1), _LONGEST_REST_S)

    def _healthy(self, now: float, waiting: Collection[int]) -> Poll | None:
        settings = None if self._last_was_settings else self._settings.pop(now, self._is_healthy)
        self._last_was_settings = settings is not None
        if settings is not None:
            return settings
        is_free = self._free(waiting) if waiting else self._is_healthy
        swept = None if self._last_was_swept else self._sweep.pop(now, self._is_healthy, is_free)
        self._last_was_swept = swept is not None
        if swept is not None:
            return swept
        return self._rotation.pop(is_free) or self._sweep.any(now, is_free)

    def _free(self, waiting: Collection[int]) -> IsHealthy:
        """Return which stations can be read now; where all of them have to wait: any."""

        def is_free(address: int) -> bool:
            return address not in waiting and self._is_healthy(address)

        return is_free if any(map(is_free, self._presences)) else self._is_healthy

    def _made(self, poll: Poll, *, risky: bool) -> Poll:
        self._last, self._last_was_risky = poll, risky
        return poll

    def _is_healthy(self, address: int) -> bool:
        presence = self._presences[address]
        return presence.online and presence.suspect is None

    def _is_healthys_turn(self) -> bool:
        if self._last is None:
            return False
        return self._last_was_risky or not self._is_healthy(self._last.address)

    def _risky(self, now: float, *, alone: bool) -> Poll | None:
        """Return a retry or a probe: usually the retry, but probes must get their turn too.

        An urgent probe comes before both: there is at most one a second.
        """
        if not self._is_anybody_ill():
            return None
        urgent = self._urgent()
        if urgent is not None:
            return urgent
        probe = None
        if self._retries_in_a_row >= _RETRIES_IN_A_ROW:
            probe = self._probe(now, alone=alone)
        retry = self._retry(now) if probe is None else None
        self._retries_in_a_row = self._retries_in_a_row + 1 if retry else 0
        return probe or retry or self._probe(now, alone=alone)

    def _is_anybody_ill(self) -> bool:
        for presence in self._presences.values():
            if presence.suspect is not None or not presence.online:
                return True
        return False

    def _urgent(self) -> Poll | None:
        for address, presence in self._presences.items():
            if presence.urgent and not presence.online:
                return self._probed_now(address)
        return None

    def _retry(self, now: float) -> Poll | None:
        """Return the suspect read that is longest overdue, if one is due."""
        due = [(at, poll) for at, poll in self._retries() if at <= now]
        return min(due, key=lambda item: item[0])[1] if due else None

    def _retries(self) -> Iterator[tuple[float, Poll]]:
        for address, presence in self._presences.items():
            if presence.suspect is not None:
                yield presence.retry_at, Poll(address, presence.suspect)

    def _probe(self, now: float, *, alone: bool) -> Poll | None:
        """Return the offline station whose probe is longest overdue, at most one in a cycle."""
        if not alone and not self._round_is_over():
            return None
        due = [
            (presence.probe_at, address)
            for address, presence in self._presences.items()
            if not presence.online and presence.probe_at <= now
            if alone or now >= self._probe_from or presence.is_new
        ]
        if not due:
            return None
        return self._probed_now(min(due)[1])

    def _probed_now(self, address: int) -> Poll:
        self._reads_since_probe = 0
        self._probed = address
        return Poll(address, Kind.CONTACT)

    def _round_is_over(self) -> bool:
        """Return whether each healthy read was made since the last probe in vain."""
        if self._probed is None or self._presences[self._probed].online:
            return True
        return self._reads_since_probe >= sum(self._is_healthy(p.address) for p in self._polls)

    def _next_risky_at(self) -> float:
        """Return when the next retry or probe is due, if no station is healthy."""
        probes = [p.probe_at for p in self._presences.values() if not p.online]
        return min([*probes, *(at for at, _ in self._retries())])
