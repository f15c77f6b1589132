import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.line.rules.histogram import Histogram
from bridge.model import Spread


def filled(*durations_s: float) -> Histogram:
    """A histogram of these."""
    histogram = Histogram()
    for duration_s in durations_s:
        histogram.add(duration_s)
    return histogram


def test_without_durations_there_is_no_spread() -> None:
    """Without durations there is no spread, at first and after a clear."""
    histogram = Histogram()
    assert histogram.spread() is None
    histogram.add(1.0)
    histogram.clear()
    assert histogram.spread() is None
    assert histogram.longest_s == 0.0


def test_one_duration_is_all_of_it() -> None:
    """A single sample is told exactly: no figure is longer than the longest."""
    assert filled(0.0234).spread() == Spread(0.0234, 0.0234)


@given(st.lists(st.floats(0.0002, 90.0), min_size=1, max_size=300))
def test_percentiles_are_at_most_five_percent_too_long(durations_s: list[float]) -> None:
    """Each figure covers its share, and hardly more than the sorted samples say."""
    spread = filled(*durations_s).spread()
    assert spread is not None
    ranked = sorted(durations_s)
    for figure_s, share in ((spread.p50_s, 0.5), (spread.p99_s, 0.99)):
        exact_s = ranked[-int(-share * len(ranked) // 1) - 1]
        assert exact_s * (1 - 1e-9) <= figure_s <= exact_s * 1.05 * (1 + 1e-9)


@pytest.mark.parametrize("duration_s", [0.0, 0.00001, 1e-300])
def test_what_takes_no_time_counts_as_the_least(duration_s: float) -> None:
    """A clock that did not move breaks nothing."""
    assert filled(duration_s, duration_s).spread() == Spread(duration_s, duration_s)


def test_what_lasts_longer_than_any_bucket_counts_in_the_last() -> None:
    """The middle stays right, and the longest is kept as it is."""
    histogram = filled(0.1, 0.1, 5000.0)
    spread = histogram.spread()
    assert spread is not None
    assert spread.p50_s == pytest.approx(0.1, rel=0.05)
    assert 100.0 <= spread.p99_s <= 5000.0
    assert histogram.longest_s == 5000.0


def test_it_does_not_grow() -> None:
    """The size of a histogram is constant, however many durations are added."""
    dice = random.Random(1)  # noqa: S311  # durations, no secrets
    histogram = Histogram()
    before = len(histogram._buckets)
    for _ in range(20_000):
        histogram.add(dice.lognormvariate(-3, 3))
    assert len(histogram._buckets) == before
