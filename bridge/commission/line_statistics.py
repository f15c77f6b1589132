"""Counts of what was heard on a line, by station."""

from collections import deque
from dataclasses import dataclass, field

from bridge.protocol.passive.listener import Heard, PieceWay

_TIMES_KEPT = 1000  # the last ones, for the median: a line may be watched for weeks


@dataclass(slots=True)
class StationCounts:
    """One station, or the pieces that belong to no known station."""

    requests: int = 0
    replies: int = 0
    refused: int = 0
    unanswered: int = 0
    damaged: int = 0
    reply_max_s: float = 0.0
    _reply_s: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES_KEPT))

    def count(self, heard: Heard) -> None:
        """Count one piece."""
        if heard.unanswered:
            self.unanswered += 1
        elif heard.way is PieceWay.REQUEST:
            self.requests += 1
        elif heard.refused and heard.reply_s is not None:
            self.refused += 1
        elif heard.problem:
            self.damaged += 1
        else:
            self.replies += 1
        if heard.reply_s is not None:
            self._reply_s.append(heard.reply_s)
            self.reply_max_s = max(self.reply_max_s, heard.reply_s)

    @property
    def reply_p50_s(self) -> float | None:
        """Return the median of the last reply times, from last byte to last byte."""
        times = sorted(self._reply_s)
        return times[len(times) // 2] if times else None


class HeardStatistics:
    """All stations of a line.

    Attributes:
        frames: The number of frames heard.
        by_station: The counts; None: the station is not known.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.by_address: dict[int | None, StationCounts] = {}

    def count(self, heard: Heard) -> None:
        """Count one piece."""
        if heard.protocol and heard.data:
            self.frames += 1
        self.by_address.setdefault(heard.address, StationCounts()).count(heard)
