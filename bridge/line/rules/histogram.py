"""A histogram of durations with a fixed number of buckets: fast, and it never grows."""

import math
from array import array
from itertools import accumulate

from bridge.model import Spread

_LEAST_S = 0.0001
_MOST_S = 100.0
_WIDTH = 1.05  # each bucket is 5 % wider than the one before
_PER_NATURAL_LOG = 1 / math.log(_WIDTH)
_BUCKETS = math.ceil(math.log(_MOST_S / _LEAST_S) * _PER_NATURAL_LOG) + 1


class Histogram:
    """Counts durations from 0.1 ms to 100 s; others count as the nearest of these.

    A line has several for each station, so a bucket has only four bytes.
    """

    __slots__ = ("_buckets", "_count", "longest_s")

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._count = 0
        self._buckets = _empty()

    def add(self, duration_s: float) -> None:
        """Add a duration."""
        index = 0
        if duration_s > _LEAST_S:
            index = min(math.ceil(math.log(duration_s / _LEAST_S) * _PER_NATURAL_LOG), _BUCKETS - 1)
        self._buckets[index] += 1
        self._count += 1
        self.longest_s = max(self.longest_s, duration_s)

    def clear(self) -> None:
        """Remove all durations."""
        self.longest_s = 0.0
        self._count = 0
        self._buckets = _empty()

    def spread(self) -> Spread | None:
        """Return median and 99th percentile, at most 5 % too long; None: there is no duration."""
        if not self._count:
            return None
        return Spread(p50_s=self._reached_by(0.5), p99_s=self._reached_by(0.99))

    def _reached_by(self, share: float) -> float:
        """Return the end of the bucket that reaches this share of all durations."""
        wanted = math.ceil(share * self._count)
        index = next(i for i, reached in enumerate(accumulate(self._buckets)) if reached >= wanted)
        return min(_LEAST_S * _WIDTH**index, self.longest_s)


def _empty() -> "array[int]":
    return array("I", bytes(4 * _BUCKETS))
