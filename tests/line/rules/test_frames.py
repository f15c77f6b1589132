"""Which write frames a command takes."""

from hypothesis import given
from hypothesis import strategies as st

from bridge.line.rules.frames import frames_for, gaps_in
from bridge.model import channels_of

MASKS = st.integers(1, 0xFFFF)


def test_gaps_lie_between_the_outputs() -> None:
    """Gaps are the outputs between the lowest and the highest of the mask."""
    assert gaps_in(0b0100_1100) == 0b0011_0000
    assert gaps_in(0b1110) == 0


def test_one_range_goes_over_gaps_that_may_be_written() -> None:
    """A range covers gaps that may be written, because this is the shortest write."""
    assert frames_for(0b1001, 0b1001, spared=0b1_0000) == [0b1001]


def test_a_spared_output_splits_the_write_into_runs() -> None:
    """A spared output splits the write into runs, and then no gap is written."""
    assert frames_for(0b1011_0011, 0xFF, spared=0b100) == [0b11, 0b11_0000, 0b1000_0000]


def test_what_only_switches_off_goes_first() -> None:
    """Break before make."""
    assert frames_for(0b101, 0b001, spared=0b010) == [0b100, 0b001]


@given(MASKS, MASKS, MASKS)
def test_each_output_is_written_once_and_no_spared_one_is(
    mask: int, values: int, spared: int
) -> None:
    """For any request each output is written once, and no spared one is."""
    frames = frames_for(mask, values & mask, spared & ~mask)
    assert sorted(n for frame in frames for n in channels_of(frame)) == list(channels_of(mask))
    assert not any(gaps_in(frame) & spared & ~mask for frame in frames)
