"""Values that a reload must not forget: the ids of commands, and the orders during a loss.

A reload may start new lines, or the whole bridge at another broker, in the same process. The memory
is made once for the process and passed on. Only the main thread uses it.
"""

from bridge.hub.admission import SeenIds
from bridge.model import LeftCovers, Orders, StandingCovers


class Loss:
    """The present loss of the broker, and the orders of `on_loss` in it.

    Attributes:
        since: When it began (`bridge.clock.boot_s`); None: the broker is present.
        done: Station and output of each order that may not be repeated in this loss.
    """

    def __init__(self) -> None:
        self.since: float | None = None
        self.done = Orders()

    def turn(self, *, away: bool, now: float) -> bool:
        """Update whether the broker is away; return whether that changed."""
        if away == (self.since is not None):
            return False
        self.since = now if away else None
        self.done = Orders()
        return True

    def carried_out(self, station_id: str, output: int) -> None:
        """Remember an order of this loss, so that a reload does not repeat it."""
        if self.since is not None:
            self.done |= {(station_id, output)}


class Memory:
    """The values that outlive every reload.

    Attributes:
        seen_ids: The ids of the commands of the last 60 s.
        loss: The present loss of the broker.
        left_covers: Covers whose motor the last run could not stop.
        rules_off: The ids of the rules that are switched off.
        rules_known: Whether `rules_off` has what an earlier process kept.
        standing_covers: Where covers stood at its end.
    """

    def __init__(self) -> None:
        self.seen_ids = SeenIds()
        self.loss = Loss()
        self.left_covers = LeftCovers()
        self.rules_off = frozenset[str]()
        self.rules_known = False
        self.standing_covers = StandingCovers()
