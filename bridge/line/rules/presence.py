"""Decides whether a module is online, and when it is asked again.

Time is an argument (`bridge.clock.boot_s`).
"""

import math
from collections.abc import Mapping
from enum import StrEnum

# docs/contract.md, promise 7: offline after 8 misses and 2 s, within 5 s; then probed less and less
# often.
OFFLINE_MISSES = 8
OFFLINE_SILENT_S = 2.0
# On a slow line eight misses of one module would take longer than this.
OFFLINE_AGE_S = 4.0
OFFLINE_AGE_MISSES = 5
RETRY_S = 0.25
PROBE_FIRST_S = 0.5
PROBE_LAST_S = 30.0
URGENT_PROBE_S = 1.0


class Kind(StrEnum):
    """The channels that a poll reads."""

    CONTACT = "contact"
    INPUTS = "inputs"
    OUTPUTS = "outputs"
    SETTINGS = "settings"


class Presence:
    """The presence of one module. It begins as offline, with a contact due at once.

    After a miss only the read that missed is repeated, until it is answered or the module is
    offline. So a dead module costs one time-out at a time. And a module that answers for its inputs
    but never for its outputs does not stay online.

    Attributes:
        online: Its values are known, and it answers or has missed only recently.
        probe_at: When to contact it, while it is offline.
        suspect: The read that got no valid reply, while it is online; None: no miss.
        retry_at: When to repeat that read: soon, so that the case is decided within 5 s.
        misses: The number of misses of that read in a row.
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
        """Record that its first good reads were made: it is online."""
        self.online = True
        self.urgent = False
        self._probe_pause_s = PROBE_FIRST_S
        self.answered(now)

    def answered(self, now: float) -> None:
        """Record a valid reply while online."""
        self.suspect = None
        self.misses = 0
        self.heard_at = now

    def missed(self, kind: Kind, now: float, free_at: float = 0.0) -> None:
        """Record a miss while online; the bus does not ask before `free_at`."""
        if self.suspect is None:
            self._missed_at = now
        self.suspect = kind
        self.misses += 1
        self.retry_at = max(now + RETRY_S, free_at)

    def ignored(self, now: float, times: int) -> None:
        """Record that `times` requests of an order and the read after it got no valid reply."""
        if self.suspect is None:
            self.missed(Kind.OUTPUTS, now)
            self.retry_at = now  # the next read decides whether it is there
            times -= 1
        self.misses += times

    @property
    def is_new(self) -> bool:
        """Return whether it was not missed yet: neither by a read nor by a contact."""
        return self._probe_pause_s == PROBE_FIRST_S

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
        """Record that it is offline: it is probed soon, then less and less often."""
        if self.suspect is None:
            self.probe_at = now  # the whole line is gone: this module was not asked
        else:
            self.absent(now)
        self.online = False
        self.suspect = None

    def absent(self, now: float) -> None:
        """Record a contact without an answer, or with a wrong one."""
        self.urgent = False
        self.probe_at = now + self._probe_pause_s
        self._probe_pause_s = min(2 * self._probe_pause_s, PROBE_LAST_S)

    def noticed(self, now: float) -> None:
        """Record a valid reply while offline: it is there."""
        self.heard_at = now

    def interrupted(self, now: float) -> None:
        """Record a contact that began with an answer and was not finished: repeat it soon."""
        self.urgent = False
        self.probe_at = now + PROBE_FIRST_S
        self._probe_pause_s = 2 * PROBE_FIRST_S

    def hasten(self, now: float) -> None:
        """Contact it now, out of turn; the times of the other probes stay as they are."""
        self.probe_at = min(self.probe_at, now)
        self.urgent = True

    def lost(self, now: float) -> None:
        """Record that the port was lost: contact every module again, at once."""
        self.urgent = False
        self.online = False
        self.suspect = None
        self.probe_at = now
        self._probe_pause_s = PROBE_FIRST_S


class UrgentProbes:
    """Probes offline modules for which something is due, such as a motor that has to stop.

    One probe a second for the whole line, in turn; if a probe takes long, at most half of the time.
    So they cost the others little, however many there are (docs/contract.md, promise 7).

    Attributes:
        next_at: When `work` has a probe to make; infinity: nothing is due.
    """

    def __init__(self) -> None:
        self.next_at = math.inf
        self._asked_at: dict[int, float] = {}
        self._pending: Presence | None = None
        self._begun_at = 0.0
        self._free_at = 0.0

    def work(self, due: Mapping[int, Presence], now: float) -> None:
        """Mark the next probe; `due` are the presences, by station, for which something is due."""
        if self._pending is not None:
            if self._pending.urgent:
                return  # it comes when the line is free
            self._pending = None
            self._free_at = max(self._begun_at + URGENT_PROBE_S, now + (now - self._begun_at))
        offline = [address for address, presence in due.items() if not presence.online]
        self.next_at = self._free_at if offline else math.inf
        if now < self.next_at:
            return
        address = min(offline, key=lambda address: self._asked_at.get(address, 0.0))
        self._pending = due[address]
        self._asked_at[address] = self._begun_at = now
        self.next_at = math.inf  # not before the present one was made
        self._pending.hasten(now)


def fallen_silent(presences: Mapping[int, Presence], now: float) -> list[int]:
    """Return the stations that are offline from now on.

    Misses of all modules are counted together. If a cable is cut or a cabinet loses its supply,
    eight time-outs of each module would take minutes, and eight misses in a row are as improbable
    when several modules share them. If no module was heard while they were counted, all are
    offline; else those that have been silent for 2 s.
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
