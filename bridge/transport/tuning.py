"""Learns the times of the modules of a line, where its configuration says `auto`. Pure.

What is learned only makes a line more patient: a time is never below the one that is in force
before anything is learned. It belongs to one module, and is forgotten when that goes offline.
"""

from collections import defaultdict
from dataclasses import dataclass

from bridge.config.schema import LONGEST_LEARNED_S, LineConfig
from bridge.model import Learned
from bridge.transport.timing import LineTiming

_MARGIN = 1.25  # over the longest that was seen
_LEAST_SILENCE_S = 0.001
_LONGEST_SILENCE_S = 0.02


@dataclass(slots=True)
class _Seen:
    """When the latest reply of a module began, and the silence with which it misses requests."""

    longest_s: float = 0.0
    silence_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Tuned:
    """Which times are learned."""

    turnaround: bool = False
    late_window: bool = False
    silence: bool = False

    @classmethod
    def of(cls, line: LineConfig) -> "Tuned":
        """Return what the configuration of a line leaves to us."""
        turnaround = line.turnaround_auto and line.timeout_s is None
        return cls(turnaround, line.late_window_auto, line.silence_s is None)


FIXED = Tuned()


class Tuning:
    """The times of a line for each of its stations. One thread owns it."""

    def __init__(self, timing: LineTiming, late_window_s: float, tuned: Tuned) -> None:
        """Create it; `timing` and `late_window_s` are in force until something is learned."""
        self._timing = timing
        self._late_window_s = late_window_s
        self._tuned = tuned
        self._seen: defaultdict[int, _Seen] = defaultdict(_Seen)

    @property
    def learns_lateness(self) -> bool:
        """Return whether it matters when a reply begins."""
        return self._tuned.turnaround or self._tuned.late_window

    def turnaround_s(self, address: int) -> float:
        """Return the turnaround of a station: a time-out adds its margin to it."""
        timing = self._timing
        if not self._tuned.turnaround:
            return timing.turnaround_s
        return max(timing.turnaround_s, self._patience_s(address) - timing.margin_s)

    def late_window_s(self, address: int) -> float:
        """Return how long after a time-out a reply of a station may still come."""
        if not self._tuned.late_window:
            return self._late_window_s
        return max(self._late_window_s, self._patience_s(address))

    def silence_s(self, address: int) -> float:
        """Return the silence to keep before a request to a station."""
        return max(self._timing.silence_s, self._seen[address].silence_s)

    def replied(self, address: int, began_s: float) -> None:
        """Note how long after the end of a request its reply began, in time or late."""
        seen = self._seen[address]
        seen.longest_s = max(seen.longest_s, began_s)

    def wants_silence(self, address: int) -> bool:
        """Keep more silence before requests to a station; return False if that is not learned."""
        now_s = self.silence_s(address)
        if not self._tuned.silence or now_s >= _LONGEST_SILENCE_S:
            return False
        self._seen[address].silence_s = min(max(2 * now_s, _LEAST_SILENCE_S), _LONGEST_SILENCE_S)
        return True

    def forget(self, address: int) -> None:
        """Forget a module: another one may have taken its place."""
        self._seen.pop(address, None)

    def learned(self, address: int) -> Learned:
        """Return the times in force for a station; `silence: auto` only where it was not enough."""
        silence_s = self._seen[address].silence_s
        return Learned(
            self.turnaround_s(address) if self._tuned.turnaround else None,
            self.late_window_s(address) if self._tuned.late_window else None,
            silence_s or None,
        )

    def _patience_s(self, address: int) -> float:
        # Noise can look like a late reply, so there is a limit.
        return min(_MARGIN * self._seen[address].longest_s, LONGEST_LEARNED_S)
