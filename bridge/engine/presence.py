"""Decides whether a module is there: when it counts as gone, and when it is asked again.

Time comes in as an argument: monotonic seconds.
"""

from enum import Enum

# CONTRACT.md, promise 7: offline after 8 misses and 2 s, within 5 s; then probed ever more rarely.
OFFLINE_MISSES = 8
OFFLINE_SILENT_S = 2.0
# On a line where many modules fall silent at once, eight probes of each take too long: a module
# that was not heard for this long and missed a few in a row is offline all the same.
OFFLINE_AGE_S = 4.5
OFFLINE_AGE_MISSES = 3
RETRY_S = 0.25
PROBE_FIRST_S = 0.5
PROBE_LAST_S = 30.0


class Kind(Enum):
    """What one poll reads."""

    CONTACT = "contact"
    INPUTS = "inputs"
    OUTPUTS = "outputs"


class _Silence:
    """Consecutive misses of one kind of read."""

    __slots__ = ("first_at", "last_good_at", "misses", "retry_at")

    def __init__(self, now: float) -> None:
        self.misses = 0
        self.first_at = now
        self.retry_at = now
        self.last_good_at = now

    def is_final(self, now: float) -> bool:
        if self.misses >= OFFLINE_MISSES and now - self.first_at >= OFFLINE_SILENT_S:
            return True
        return self.misses >= OFFLINE_AGE_MISSES and now - self.last_good_at >= OFFLINE_AGE_S


class Presence:
    """One module's presence. It starts as gone, and due to be contacted at once.

    Kinds are counted apart: a module that answers for its inputs and never for its outputs
    has outputs that nobody knows, and that is not online.
    """

    def __init__(self) -> None:
        self.online = False
        self.probe_at = 0.0
        self._probe_pause_s = PROBE_FIRST_S
        self._silences: dict[Kind, _Silence] = {}

    def arrived(self, now: float) -> None:
        """Its first good reads were made: it is online."""
        self.online = True
        self._probe_pause_s = PROBE_FIRST_S
        self._silences = {kind: _Silence(now) for kind in (Kind.INPUTS, Kind.OUTPUTS)}

    def lost(self, now: float) -> None:
        """The port went away: everything is to be asked anew, at once."""
        self.online = False
        self.probe_at = now
        self._probe_pause_s = PROBE_FIRST_S

    def answered(self, kind: Kind, now: float) -> None:
        """A valid reply came while online."""
        silence = self._silences[kind]
        silence.misses = 0
        silence.last_good_at = now

    def missed(self, kind: Kind, now: float) -> bool:
        """A read got no valid reply. Returns True when that takes the module offline."""
        if not self.online:
            self.probe_at = now + self._probe_pause_s
            self._probe_pause_s = min(2 * self._probe_pause_s, PROBE_LAST_S)
            return False
        silence = self._silences[kind]
        silence.misses += 1
        if silence.misses == 1:
            silence.first_at = now
        silence.retry_at = now + RETRY_S
        if not silence.is_final(now):
            return False
        self.online = False
        self.probe_at = now + self._probe_pause_s
        return True

    def suspect(self, kind: Kind) -> bool:
        """Whether the last read of this kind got no valid reply."""
        return self._silences[kind].misses > 0

    def retry_at(self, kind: Kind) -> float:
        """When a suspect kind is read again: fast, so that an outage is settled within 5 s."""
        return self._silences[kind].retry_at
