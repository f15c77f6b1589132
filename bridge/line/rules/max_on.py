"""Decides when an output was ON for long enough. Time comes in as an argument: monotonic seconds.

docs/contract.md, promise 4: a configured `max_on` does what it says.
"""

from bridge.line.rules.retry import Retry


class MaxOn:
    """One output that goes OFF after it was seen ON for `limit_s`, by whomever it was switched.

    While its module is away nothing is seen: if it is ON when it comes back, it counts as having
    been ON all the time.
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
        """Return what it has to say for itself."""
        return f"it was ON for {self._limit_s:g} s"

    @property
    def failing(self) -> bool:
        """Return whether the last order was in vain."""
        return self._retry.failing

    def seen(self, on: bool, now: float) -> None:
        """Note that the module said what the output is."""
        if not on:
            self._since = None
            self._retry.reset()
        elif self._since is None:
            self._since = now

    def broker(self, away_since: float | None) -> None:
        """Do nothing: it does not depend on the broker."""

    def is_due(self, now: float) -> bool:
        """Return whether it is to be switched now."""
        if self._since is None or now < self._since + self._limit_s:
            return False
        return self._retry.may_try(now)

    def tried(self, *, over: bool, now: float) -> None:
        """Note that it was ordered OFF; `over`: it is."""
        if over:
            self._since = None
            self._retry.reset()
        else:
            self._retry.failed(now)
