"""What a reload must not forget: which commands were seen, and what was done in a loss.

A reload may start lines anew, or the whole bridge at another broker, in the same process. The
memory is made once a process and handed on. Only the main thread uses it.
"""

from bridge.hub.admission import SeenIds
from bridge.model import LeftCovers, Orders


class Loss:
    """Since when the broker is away, and what `on_loss` did since then.

    Attributes:
        since: The instant of `bridge.clock.boot_s`; None: the broker is there.
        done: Station and output of each order that may not be made again in this loss.
    """

    def __init__(self) -> None:
        self.since: float | None = None
        self.done = Orders()

    def turn(self, *, away: bool, now: float) -> bool:
        """Take in whether the broker is away now; return whether that is new."""
        if away == (self.since is not None):
            return False
        self.since = now if away else None
        self.done = Orders()
        return True

    def carried_out(self, station: str, output: int) -> None:
        """Remember an order of this loss: a reload does not make it again."""
        if self.since is not None:
            self.done |= {(station, output)}


class Memory:
    """Describe what outlives every reload.

    Attributes:
        seen_ids: The ids of the commands of the last 60 s.
        loss: What was done while the broker is away.
        left_covers: Those whose motor the run before this one could not stop.
    """

    def __init__(self) -> None:
        self.seen_ids = SeenIds()
        self.loss = Loss()
        self.left_covers = LeftCovers()
