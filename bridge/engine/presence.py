"""Decides whether a module is there: when it counts as gone, and when it is asked again.

Time comes in as an argument: monotonic seconds.
"""

from collections.abc import Mapping
from enum import StrEnum

# CONTRACT.md, promise 7: offline after 8 misses and 2 s, within 5 s; then probed ever more rarely.
OFFLINE_MISSES = 8
OFFLINE_SILENT_S = 2.0
# A slow line comes round to a module so late that eight misses would take longer than that.
OFFLINE_AGE_S = 4.0
OFFLINE_AGE_MISSES = 5
RETRY_S = 0.25
PROBE_FIRST_S = 0.5
PROBE_LAST_S = 30.0


class Kind(StrEnum):
    """What one poll reads."""

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
    """

    __slots__ = (
        "_heard_at",
        "_missed_at",
        "_probe_pause_s",
        "misses",
        "online",
        "probe_at",
        "retry_at",
        "suspect",
    )

    def __init__(self) -> None:
        self.online = False
        self.probe_at = 0.0
        self.suspect: Kind | None = None
        self.retry_at = 0.0
        self.misses = 0
        self._heard_at = 0.0
        self._missed_at = 0.0
        self._probe_pause_s = PROBE_FIRST_S

    def arrived(self, now: float) -> None:
        """Its first good reads were made: it is online."""
        self.online = True
        self._probe_pause_s = PROBE_FIRST_S
        self.answered(now)

    def answered(self, now: float) -> None:
        """A valid reply came while online."""
        self.suspect = None
        self.misses = 0
        self._heard_at = now

    def missed(self, kind: Kind, now: float, free_at: float = 0.0) -> None:
        """A read got no valid reply while online; the bus does not ask again before `free_at`."""
        if self.suspect is None:
            self._missed_at = now
        self.suspect = kind
        self.misses += 1
        self.retry_at = max(now + RETRY_S, free_at)

    def silent_s(self, now: float) -> float:
        """How long its reads have been missed."""
        return now - self._missed_at if self.suspect is not None else 0.0

    def silent_since(self, instant: float) -> bool:
        """Whether no valid reply came after that instant."""
        return self._heard_at < instant

    def is_overdue(self, now: float) -> bool:
        """Whether it was asked often and not heard for so long that its values are too old."""
        often = self.misses >= OFFLINE_AGE_MISSES and self.silent_s(now) >= OFFLINE_SILENT_S
        return often and now - self._heard_at >= OFFLINE_AGE_S

    def gone(self, now: float) -> None:
        """It is offline from now on: probed soon, and ever more rarely."""
        if self.suspect is None:
            self.probe_at = now  # gone with the whole line: it was not even asked
        else:
            self.absent(now)
        self.online = False
        self.suspect = None

    def absent(self, now: float) -> None:
        """A contact found nothing, or not what it should."""
        self.probe_at = now + self._probe_pause_s
        self._probe_pause_s = min(2 * self._probe_pause_s, PROBE_LAST_S)

    def lost(self, now: float) -> None:
        """The port went away: everything is to be asked anew, at once."""
        self.online = False
        self.suspect = None
        self.probe_at = now
        self._probe_pause_s = PROBE_FIRST_S


def fallen_silent(presences: Mapping[int, Presence], now: float) -> list[int]:
    """The stations that count as gone from now on.

    Misses are counted together: where a cable is cut, or a cabinet loses its supply, eight
    time-outs of each module would take minutes, and eight misses in a row by chance are as rare
    however they are spread. If nobody at all was heard while they were counted, then everybody
    is gone; else those that have been silent for 2 s.
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
