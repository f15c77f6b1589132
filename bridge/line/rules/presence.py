"""Decides whether a module is there: when it counts as gone, and when it is asked again.

Time comes in as an argument: monotonic seconds.
"""

import math
from collections.abc import Mapping
from enum import StrEnum

# docs/contract.md, promise 7: offline after 8 misses and 2 s, within 5 s; then probed ever more
# rarely.
OFFLINE_MISSES = 8
OFFLINE_SILENT_S = 2.0
# A slow line comes round to a module so late that eight misses would take longer than that.
OFFLINE_AGE_S = 4.0
OFFLINE_AGE_MISSES = 5
RETRY_S = 0.25
PROBE_FIRST_S = 0.5
PROBE_LAST_S = 30.0
URGENT_PROBE_S = 1.0


class Kind(StrEnum):
    """Describe what one poll reads."""

    CONTACT = "contact"
    INPUTS = "inputs"
    OUTPUTS = "outputs"
    SETTINGS = "settings"


class Presence:
    """One module's presence. It starts as gone, and due to be contacted at once.

    From a miss on only the read that missed is tried again, until it is answered or the module
    is gone: a dead module costs one time-out at a time, and one that answers for its inputs but
    never for its outputs is not kept online by its inputs.

    Attributes:
        online: Its values are known and it answers, or failed to only lately.
        probe_at: When to contact it, while it is offline.
        suspect: The read that got no valid reply, while it is online; None: all is well.
        retry_at: When to try that read again: fast, so that an outage is settled within 5 s.
        misses: How often that read was missed in a row.
        heard_at: When it last answered a read.
        urgent: It is offline, and contacted before any other: see `UrgentProbes`.
    """

    __slots__ = (
        "_missed_at",
        "_probe_pause_s",
        "heard_at",
        "misses",
        "online",
        "probe_at",
        "retry_at",
        "suspect",
        "urgent",
    )

    def __init__(self) -> None:
        self.online = False
        self.probe_at = 0.0
        self.suspect: Kind | None = None
        self.retry_at = 0.0
        self.misses = 0
        self.heard_at = 0.0
        self.urgent = False
        self._missed_at = 0.0
        self._probe_pause_s = PROBE_FIRST_S

    def arrived(self, now: float) -> None:
        """Note that its first good reads were made: it is online."""
        self.online = True
        self.urgent = False
        self._probe_pause_s = PROBE_FIRST_S
        self.answered(now)

    def answered(self, now: float) -> None:
        """Note that a valid reply came while online."""
        self.suspect = None
        self.misses = 0
        self.heard_at = now

    def missed(self, kind: Kind, now: float, free_at: float = 0.0) -> None:
        """A read got no valid reply while online; the bus does not ask again before `free_at`."""
        if self.suspect is None:
            self._missed_at = now
        self.suspect = kind
        self.misses += 1
        self.retry_at = max(now + RETRY_S, free_at)

    def ignored(self, now: float, times: int) -> None:
        """Take in that an order got no valid reply to so many requests, nor to a read after it."""
        if self.suspect is None:
            self.missed(Kind.OUTPUTS, now)
            self.retry_at = now  # the next read tells whether it is there
            times -= 1
        self.misses += times

    def silent_s(self, now: float) -> float:
        """Return how long its reads have been missed."""
        return now - self._missed_at if self.suspect is not None else 0.0

    def silent_since(self, instant: float) -> bool:
        """Return whether no valid reply came after that instant."""
        return self.heard_at < instant

    def is_overdue(self, now: float) -> bool:
        """Return whether it was asked often, and its values are too old."""
        often = self.misses >= OFFLINE_AGE_MISSES and self.silent_s(now) >= OFFLINE_SILENT_S
        return often and now - self.heard_at >= OFFLINE_AGE_S

    def gone(self, now: float) -> None:
        """Note that it is offline from now on: probed soon, and ever more rarely."""
        if self.suspect is None:
            self.probe_at = now  # gone with the whole line: it was not even asked
        else:
            self.absent(now)
        self.online = False
        self.suspect = None

    def absent(self, now: float) -> None:
        """A contact found nothing, or not what it should."""
        self.urgent = False
        self.probe_at = now + self._probe_pause_s
        self._probe_pause_s = min(2 * self._probe_pause_s, PROBE_LAST_S)

    def hasten(self, now: float) -> None:
        """Note that it is contacted now, out of turn.

        How often it is probed besides stays as it is.
        """
        self.probe_at = min(self.probe_at, now)
        self.urgent = True

    def lost(self, now: float) -> None:
        """Note that the port went away: everything is to be asked anew, at once."""
        self.urgent = False
        self.online = False
        self.suspect = None
        self.probe_at = now
        self._probe_pause_s = PROBE_FIRST_S


class UrgentProbes:
    """Probes modules that are offline while something is due there: a motor that has to stop.

    One a second for the whole line, in turn, and where a probe takes long at most half of the
    time: so they cost the others little, however many there are (docs/contract.md, promise 7).

    Attributes:
        next_at: When `work` has one to make; infinity: nothing is due.
    """

    def __init__(self) -> None:
        self.next_at = math.inf
        self._asked_at: dict[int, float] = {}
        self._pending: Presence | None = None
        self._begun_at = 0.0
        self._free_at = 0.0

    def work(self, due: Mapping[int, Presence], now: float) -> None:
        """`due`: the presences, by station, of the modules where something is due."""
        if self._pending is not None:
            if self._pending.urgent:
                return  # it comes when the line is free
            self._pending = None
            self._free_at = max(self._begun_at + URGENT_PROBE_S, now + (now - self._begun_at))
        offline = [station for station, presence in due.items() if not presence.online]
        self.next_at = self._free_at if offline else math.inf
        if now < self.next_at:
            return
        station = min(offline, key=lambda station: self._asked_at.get(station, 0.0))
        self._pending = due[station]
        self._asked_at[station] = self._begun_at = now
        self.next_at = math.inf  # not before this one was made
        self._pending.hasten(now)


def fallen_silent(presences: Mapping[int, Presence], now: float) -> list[int]:
    """Return the stations that count as gone from now on.

    Misses are counted together: where a cable is cut, or a cabinet loses its supply, eight
    time-outs of each module would take minutes, and eight misses in a row by chance are as rare
    however they are spread. If no module at all was heard while they were counted, then every
    module is gone; else those that have been silent for 2 s.
    """
    begun = now - max(presence.silent_s(now) for presence in presences.values())
    online = [address for address, presence in presences.items() if presence.online]
    if all(presences[address].silent_since(begun) for address in online):
        silent = online
        settled = now - begun >= OFFLINE_SILENT_S
    else:
        silent = [a for a in online if presences[a].silent_s(now) >= OFFLINE_SILENT_S]
        settled = True
    if settled and sum(presences[address].misses for address in silent) >= OFFLINE_MISSES:
        return silent
    return [address for address in online if presences[address].is_overdue(now)]
