"""Decides when an output was ON for too long. Time is an argument (`bridge.clock.boot_s`).

docs/contract.md, promise 4: a configured `max_on` does what it says.
"""

from bridge.line.rules.retry import Retry


class MaxOn:
    """One output that goes OFF after it was seen ON for `limit_s`, no matter what switched it.

    If it is ON before and after an absence of the module, it counts as ON for all that time.
    """

    __slots__ = ("_limit_s", "_retry", "_since", "output")

    cause = "max_on"
    on = False

    def __init__(self, output: int, limit_s: float) -> None:
        self.output = output
        self._limit_s = limit_s
        self._since: float | None = None
        self._retry = Retry()

    @property
    def why(self) -> str:
        """Return the reason of the order, in words."""
        return f"it was ON for {self._limit_s:g} s"

    @property
    def failing(self) -> bool:
        """Return whether the last order failed."""
        return self._retry.failing

    def seen(self, on: bool, now: float) -> None:
        """Use the value of the output that was read."""
        if not on:
            self._since = None
            self._retry.reset()
        elif self._since is None:
            self._since = now

    def broker(self, away_since: float | None) -> None:
        """Do nothing: it does not depend on the broker."""

    def is_due(self, now: float) -> bool:
        """Return whether it has to be switched now."""
        if self._since is None or now < self._since + self._limit_s:
            return False
        return self._retry.may_try(now)

    def tried(self, *, over: bool, now: float) -> None:
        """Record that it was ordered OFF; `over`: it is OFF."""
        if over:
            self._since = None
            self._retry.reset()
        else:
            self._retry.failed(now)
