"""Decides whether a command may switch interlocked outputs ON.

An output counts as ON until a read finds it OFF, so the dead time never begins too early. Time is
an argument (`bridge.clock.boot_s`).
"""

import math
from collections.abc import Iterable, Iterator, Sequence

from bridge.model import channels_of


class Interlock:
    """The groups of one module, and the known state of their outputs. Bit n-1 is output n.

    Attributes:
        grouped: The outputs that are in a group.
    """

    __slots__ = ("_dead_time_s", "_groups", "_off_since", "_on", "grouped")

    def __init__(self, groups: Sequence[int], dead_time_s: float) -> None:
        self.grouped = sum(groups)  # an output is in one group only
        self._groups = groups
        self._dead_time_s = dead_time_s
        self._on = self.grouped
        self._off_since: dict[int, float] = {}

    # --- what happens to the module -----------------------------------------------------------

    def met(self, outputs: int, now: float) -> None:
        """Record that the module is back: all outputs count as ON until now."""
        self._on = self.grouped
        self.observe(outputs, now)

    def ordered(self, values: int) -> None:
        """Record that these were ordered ON: they may be ON, even if only for a pulse."""
        self._on |= values & self.grouped

    def observe(self, outputs: int, now: float) -> None:
        """Use a read of the outputs."""
        for output in channels_of(self._on & ~outputs):
            self._off_since[output] = now
        self._on = outputs & self.grouped

    # --- what may be done ---------------------------------------------------------------------

    def concerns(self, wanted_on: int) -> bool:
        """Return whether switching these ON needs a look at others. OFF is always allowed."""
        return wanted_on & self.grouped != 0

    def contradiction(self, wanted_on: int) -> str | None:
        """Return why these cannot be ON together, in words; None: they can."""
        for group in self._groups:
            together = group & wanted_on
            if together.bit_count() > 1:
                return f"{named(together)} are interlocked: only one of them may be ON at once"
        return None

    def objection(self, mask: int, wanted_on: int, current: int, now: float) -> str | None:
        """Return why these may not go ON now, in words; None: they may.

        No two of `wanted_on` share a group. `current` is the last read, which `observe` got too;
        `mask` is all outputs that the command names.
        """
        for group in self._asked_groups(wanted_on):
            asked, others = named(group & wanted_on), group & ~wanted_on
            if others & current:
                return self._while_on(asked, others & current, mask)
            output, left_s = self._longest(others, now)
            if left_s > 0:
                return (
                    f"{asked} is interlocked with output {output}, which may have been ON until "
                    f"just now: wait {math.ceil(left_s * 10) / 10} s"
                )
        return None

    def wait_s(self, outputs: int, now: float) -> float:
        """Return the rest of the dead time before these may go ON, as far as is known."""
        since = (self._off_since[o] for o in self._others(outputs) if o in self._off_since)
        return max((instant + self._dead_time_s - now for instant in since), default=0.0)

    def clashes(self, outputs: int) -> str | None:
        """Return the interlocked outputs that are ON together, in words; None: none."""
        found = [named(g & outputs) for g in self._groups if (g & outputs).bit_count() > 1]
        return "; ".join(f"{these} are interlocked and ON at once" for these in found) or None

    def _others(self, outputs: int) -> Iterator[int]:
        for group in self._asked_groups(outputs):
            yield from channels_of(group & ~outputs)

    def _asked_groups(self, wanted_on: int) -> Iterator[int]:
        return (group for group in self._groups if group & wanted_on)

    def _while_on(self, asked: str, obstacles: int, mask: int) -> str:
        if obstacles & ~mask:
            these = f"{named(obstacles & ~mask)}, ON now"
        else:
            these = f"{named(obstacles)}, which would go OFF only in the same write"
        return (
            f"{asked} is interlocked with {these}: switch OFF first, then wait "
            f"{self._dead_time_s:.1f} s"
        )

    def _longest(self, outputs: int, now: float) -> tuple[int, float]:
        """Return the output with the longest rest of its dead time, and this rest; all are OFF."""
        output = max(channels_of(outputs), key=self._off_since.__getitem__)
        return output, self._off_since[output] + self._dead_time_s - now


def named(bits: int) -> str:
    """Return these outputs in words: `outputs 1, 3 and 4`."""
    channels: Iterable[str] = map(str, channels_of(bits))
    *some, last = channels
    return f"outputs {', '.join(some)} and {last}" if some else f"output {last}"
