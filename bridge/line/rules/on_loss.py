"""Decides what an output does when the broker is away. Time is an argument.

docs/contract.md, promise 4: a configured `on_loss` does what it says. Instants are of
`bridge.clock.boot_s`.
"""

from bridge.line.rules.retry import Retry


class OnLoss:
    """One output that takes a state, once, when the broker was away for `after_s`.

    The earlier state is not restored when the broker comes back: then commands arrive again.
    """

    __slots__ = ("_after_s", "_away_since", "_retry", "on", "output")

    cause = "on_loss"

    def __init__(self, output: int, after_s: float, *, on: bool) -> None:
        self.output = output
        self.on = on
        self._after_s = after_s
        self._away_since: float | None = None  # None: the broker is present, or everything is done
        self._retry = Retry()

    @property
    def why(self) -> str:
        """Return the reason of the order, in words."""
        return f"the broker is away for {self._after_s:g} s"

    @property
    def failing(self) -> bool:
        """Return whether the last order failed."""
        return self._retry.failing

    def seen(self, on: bool, now: float) -> None:
        """Do nothing: the present state does not matter."""

    def broker(self, away_since: float | None) -> None:
        """Use that the broker went away, or came back (None)."""
        self._away_since = away_since
        self._retry.reset()

    def is_due(self, now: float) -> bool:
        """Return whether it has to be switched now."""
        if self._away_since is None or now < self._away_since + self._after_s:
            return False
        return self._retry.may_try(now)

    def tried(self, *, over: bool, now: float) -> None:
        """Record that it was ordered; `over`: it has its state, or may not be ordered again."""
        if over:
            self._away_since = None
            self._retry.reset()
        else:
            self._retry.failed(now)
