"""Decides which write frames a command takes. Masks: bit n-1 is output n."""

from bridge.model import bit, channels_of


def gaps_in(mask: int) -> int:
    """Return the outputs between those of `mask`: a Modbus range writes them too."""
    lowest = mask & -mask
    return ((1 << mask.bit_length()) - lowest) & ~mask


def frames_for(mask: int, values: int, spared: int) -> list[int]:
    """Return the outputs of each frame for `mask`; outputs in `spared` are not written.

    This is one range over everything, or, if a spared output is in between, one frame for each run
    of neighbours. Frames that only switch OFF come first.
    """
    if not gaps_in(mask) & spared:
        return [mask]
    return sorted(_runs(mask), key=lambda run: run & values != 0)


def run_around(outputs: int, of: int) -> int:
    """Return the run of neighbours among `outputs` that holds all of `of`; 0: none does."""
    return next((run for run in _runs(outputs) if not of & ~run), 0)


def _runs(mask: int) -> list[int]:
    runs: list[int] = []
    for output in channels_of(mask):
        if runs and runs[-1] & bit(output) >> 1:
            runs[-1] |= bit(output)
        else:
            runs.append(bit(output))
    return runs
