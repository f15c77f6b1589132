"""A traced line: decodes what passes, and limits how much is published."""

from typing import TYPE_CHECKING, Any

from bridge.model import LinePassed
from bridge.protocol.passive.heard_document import heard_document
from bridge.protocol.passive.listener import Heard, Listener, PieceWay

if TYPE_CHECKING:
    from bridge.hub.line_set import Worker


class TracedLine:
    """One line that is traced.

    Args:
        until: When the trace ends (`bridge.clock.boot_s`).
        most_a_second: The limit of pieces in a second.

    Attributes:
        worker: The worker that reports; None: not asked yet.
        until: When the trace ends.
        dropped: The pieces that were not published since the last one that was.
    """

    def __init__(self, until: float, most_a_second: int) -> None:
        self.worker: Worker | None = None
        self.until = until
        self.dropped = 0
        self._listener = Listener()
        self._most_a_second = most_a_second
        self._budget = float(most_a_second)
        self._budget_at = 0.0
        self._is_let_through = True

    def hear(self, passed: LinePassed) -> list[tuple[float, dict[str, Any]]]:
        """Return the decoded pieces with their instants; those over the limit are counted.

        An exchange is published or dropped as a whole.
        """
        heard = self._listener.hear(passed.data, passed.at, sent=passed.sent)
        return [(one.at, heard_document(one)) for one in heard if self._lets_through(one)]

    def _lets_through(self, heard: Heard) -> bool:
        gained = (heard.at - self._budget_at) * self._most_a_second
        self._budget = min(self._budget + max(gained, 0.0), self._most_a_second)
        self._budget_at = max(heard.at, self._budget_at)
        if heard.way is PieceWay.REQUEST:
            self._is_let_through = self._budget >= 1
        if self._is_let_through:
            self._budget -= 1
        else:
            self.dropped += 1
        return self._is_let_through
