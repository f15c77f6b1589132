"""The times at which a module or its line had a fault, or the line was started again.

No I/O and no threads here. Instants are of `time.monotonic`.
"""

import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator

_KEPT = 500  # of each station: some ten minutes


class Disturbances:
    """By station. A motor, say, has to stop in time only while its module can be spoken to."""

    def __init__(self) -> None:
        self._spans: defaultdict[str, deque[tuple[float, float]]] = defaultdict(_few)
        self._began: dict[str, float] = {}
        self._troubles: Counter[str] = Counter()
        self._anew: defaultdict[str, deque[float]] = defaultdict(_few)

    def begin(self, stations: Iterable[str], now: float) -> None:
        """Something goes wrong at these."""
        for station_id in stations:
            self._began.setdefault(station_id, now)
            self._troubles[station_id] += 1

    def end(self, stations: Iterable[str], now: float) -> None:
        """End the disturbance."""
        for station_id in stations:
            self._troubles[station_id] -= 1
            if not self._troubles[station_id]:
                self._spans[station_id].append((self._began.pop(station_id), now))

    def began_anew(self, stations: Iterable[str], now: float) -> None:
        """The lines of these are told to end, and begin anew."""
        for station_id in stations:
            self._anew[station_id].append(now)

    def anew(self, station_id: str, since: float, until: float) -> list[float]:
        """Return when its line was told to end, between two instants."""
        return [at for at in self._anew[station_id] if since < at < until]

    def quiet(self, station_id: str, since: float, until: float) -> bool:
        """Tell whether nothing was wrong at it between two instants."""
        return not any(self._between(station_id, since, until))

    def longest_quiet_s(self, station_id: str, since: float, until: float) -> float:
        """Return for how long at a stretch nothing was wrong at it, and its line did not end."""
        spans = [*self._between(station_id, since, until)]
        spans += [(at, at) for at in self.anew(station_id, since, until)]
        longest_s = 0.0
        for begin, end in [*sorted(spans), (until, until)]:
            longest_s = max(longest_s, begin - since)
            since = max(since, end)
        return longest_s

    def _between(
        self, station_id: str, since: float, until: float
    ) -> Iterator[tuple[float, float]]:
        spans = list(self._spans[station_id])
        if station_id in self._began:
            spans.append((self._began[station_id], math.inf))
        return ((begin, end) for begin, end in spans if begin < until and end > since)


def _few() -> deque:  # type: ignore[type-arg]  # of spans, and of instants
    return deque(maxlen=_KEPT)
