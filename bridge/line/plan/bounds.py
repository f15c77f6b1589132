"""The arithmetic of a plan: the time of a cycle, and the longest time between two reads.

It holds while every module answers and no command comes. A change that has to be confirmed takes
one read more.
"""

from collections.abc import Callable, Sequence

from bridge.line.plan.rotation import SOON, lap_of
from bridge.line.plan.streams import SETTINGS_S, Poll, Streams
from bridge.line.plan.sweep import AHEAD

CostS = Callable[[Poll], float]


def cycle_s(streams: Streams, cost_s: CostS) -> float:
    """Return the longest time of a cycle: everything in the rotation is read once.

    A read of settings in between, at most one in 2 s, is not included.
    """
    laps = -(-len(streams.normal) // lap_of(len(streams.normal))) if streams.high else 0
    steady_s = _sum(streams.normal, cost_s) + max(laps, 1) * _sum(streams.high, cost_s)
    reads = len(streams.normal) + laps * len(streams.high)
    return steady_s + _swept_in_s(steady_s, reads, streams, cost_s)


def bound_s(streams: Streams, poll: Poll, cost_s: CostS) -> float:
    """Return the longest time from one read of `poll` to the end of the next."""
    if poll in streams.swept:
        return _swept_bound_s(streams, poll, cost_s)
    reads, steady_s = _steady_between(streams, poll, cost_s)
    if streams.high or len(streams.normal) > SOON:  # else its turn comes sooner
        reads += reads // SOON + 1
        steady_s += (reads // SOON + 1) * _longest(streams.normal, cost_s)

    def with_swept_s(settings_s: float) -> float:
        busy_s = steady_s + settings_s
        return busy_s + _swept_in_s(busy_s, reads, streams, cost_s, late=1) + cost_s(poll)

    return _with_settings_s(with_swept_s, streams, cost_s)


def _steady_between(streams: Streams, poll: Poll, cost_s: CostS) -> tuple[int, float]:
    """Return the most rotation reads before `poll` is made again, and their time."""
    normal, high = len(streams.normal), len(streams.high)
    lap = lap_of(normal)
    if poll in streams.high:
        some = min(lap, normal)
        return high + some, _sum(streams.high, cost_s) + some * _longest(streams.normal, cost_s)
    laps = (normal - 1) // lap + 1 if high else 0
    return normal + laps * high, _sum(streams.normal, cost_s) + laps * _sum(streams.high, cost_s)


def _swept_in_s(
    steady_s: float, reads: int, streams: Streams, cost_s: CostS, late: int = 0
) -> float:
    """Return the most time that the sweep takes during so many rotation reads.

    At most every other read belongs to the sweep. `late`: its reads that may be overdue at the
    beginning.
    """
    if not streams.swept:
        return 0.0
    each_s = streams.sweep_s * AHEAD / len(streams.swept)
    longest_s = _longest(streams.swept, cost_s)
    count = 1
    while count < reads and count * each_s < steady_s + count * longest_s:
        count += 1
    return min(count + late, reads) * longest_s


def _swept_bound_s(streams: Streams, poll: Poll, cost_s: CostS) -> float:
    """Return the bound of a swept read: as planned, or, on a slow line, every other read."""
    steady_s = _longest(streams.steady, cost_s)
    every_other = _sum(streams.swept, cost_s) + len(streams.swept) * steady_s
    every_other_s = _with_settings_s(lambda settings_s: every_other + settings_s, streams, cost_s)
    own_s = cost_s(poll) + 2 * steady_s + _longest(streams.swept, cost_s)
    settings_s = _longest(streams.settings, cost_s)
    return max(streams.sweep_s * AHEAD, every_other_s) + own_s + settings_s


def _with_settings_s(total_s: Callable[[float], float], streams: Streams, cost_s: CostS) -> float:
    """Return `total_s` of the time that reads of settings take meanwhile."""
    if not streams.settings:
        return total_s(0.0)
    each_s = SETTINGS_S * AHEAD / len(streams.settings)
    one_s = _longest(streams.settings, cost_s)
    most = len(streams.steady) + len(streams.swept)  # never two of them in a row
    count = 1
    while count < most and count * each_s < total_s(count * one_s):
        count += 1
    return total_s(count * one_s)


def _sum(polls: Sequence[Poll], cost_s: CostS) -> float:
    return sum(map(cost_s, polls))


def _longest(polls: Sequence[Poll], cost_s: CostS) -> float:
    return max(map(cost_s, polls), default=0.0)
