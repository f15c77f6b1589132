"""Decides when a failed order is tried again. Time is an argument (`bridge.clock.boot_s`)."""

FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 30.0


class Retry:
    """Growing pauses, so that a module that refuses costs the others little.

    Attributes:
        failing: The last attempt failed.
    """

    __slots__ = ("_at", "_first_s", "_longest_s", "_pause_s", "failing")

    def __init__(self, first_s: float = FIRST_PAUSE_S, longest_s: float = LONGEST_PAUSE_S) -> None:
        self._first_s = first_s
        self._longest_s = longest_s
        self.reset()

    def reset(self) -> None:
        """Begin again: it is done, or no longer wanted."""
        self.failing = False
        self._at = 0.0
        self._pause_s = self._first_s

    def failed(self, now: float) -> None:
        """Record that an attempt failed."""
        self.failing = True
        self._at = now + self._pause_s
        self._pause_s = min(2 * self._pause_s, self._longest_s)

    def may_try(self, now: float) -> bool:
        """Return whether the pause is over."""
        return not self.failing or now >= self._at
