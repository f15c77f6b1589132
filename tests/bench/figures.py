"""What was measured of one case, and how it is worked out of what was seen."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from bench.wire import Seen

Read = tuple[float, int, int, str]


@dataclass(frozen=True, slots=True)
class Spread:
    """The middle and the end of some times, in milliseconds."""

    p50: float
    p99: float
    count: int

    @classmethod
    def of(cls, seconds: Iterable[float]) -> "Spread | None":
        """None: there was not a single one."""
        ordered = sorted(seconds)
        if not ordered:
            return None
        last = len(ordered) - 1
        return cls(
            round(ordered[last // 2] * 1000, 3),
            round(ordered[round(last * 0.99)] * 1000, 3),
            len(ordered),
        )


def cycles(reads: Sequence[Read], line: int) -> Spread | None:
    """How long it took from one read of inputs to the next of the same station."""
    at: defaultdict[int, list[float]] = defaultdict(list)
    for instant, of_line, station, kind in reads:
        if kind == "inputs" and of_line == line:
            at[station].append(instant)
    return Spread.of(later - earlier for times in at.values() for earlier, later in pairwise(times))


def delays_of_inputs(seen: Seen, heard: Iterable[tuple[float, str, bytes]]) -> Spread | None:
    """From each change of an input to its message; a change that was missed counts as 60 s."""
    arrived: defaultdict[tuple[str, bytes], list[float]] = defaultdict(list)
    for at, topic, payload in heard:
        arrived[topic, payload].append(at)
    delays = []
    for changed_at, line, station, channel, on in seen.toggles:
        key = f"bench/l{line}-s{station}/di/{channel}", b"ON" if on else b"OFF"
        delays.append(
            min((at - changed_at for at in arrived[key] if at > changed_at), default=60.0)
        )
    return Spread.of(delays)
