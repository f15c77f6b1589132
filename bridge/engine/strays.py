"""Decides when bytes that nobody asked for are worth a warning (FAILURES.md A14)."""

from collections.abc import Callable

REMIND_S = 600.0
# After they were last heard replies to somebody else may still be about.
CONTESTED_S = 30.0
# Adapters that switch direction, and plugs, make a byte or two of their own; the shortest frame
# of another master has seven (PROTOCOL.md section 2), and its module answers.
_PIECE_BYTES = 3
_ENOUGH_BYTES = 6
_TOGETHER_S = 5.0


class StrayWatch:
    """Watches over one line. `warn` is given how many bytes it were, and what was heard last.

    Time comes in as an argument: monotonic seconds.
    """

    def __init__(self, warn: Callable[[int, bytes], None]) -> None:
        self._warn = warn
        self._untold = 0
        self._last_at = 0.0
        self._remind_at = 0.0
        self._contested_until = 0.0

    def heard(self, count: int, evidence: bytes, now: float) -> None:
        """Takes in bytes that came together."""
        if count < _PIECE_BYTES:
            return
        self._contested_until = now + CONTESTED_S
        if now >= self._remind_at and now - self._last_at > _TOGETHER_S:
            self._untold = 0
        self._last_at = now
        self._untold += count
        if self._untold >= _ENOUGH_BYTES and now >= self._remind_at:
            self._warn(self._untold, evidence)
            self._untold = 0
            self._remind_at = now + REMIND_S

    def is_contested(self, now: float) -> bool:
        """Return whether a reply may be one to somebody else (FAILURES.md F12)."""
        return now < self._contested_until
