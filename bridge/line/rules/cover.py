"""The position of a cover, from the time that its motor ran, and when the motor must stop.

It uses orders and reads, also of switching by others. Time is an argument (`bridge.clock.boot_s`).
"""

from enum import Enum

from bridge.config.schema import CoverConfig
from bridge.model import CoverState, bit

CLOSED, OPEN = 0, 100  # positions, in percent
# At an end the motor runs a little longer: its end switch stops it, and the position is certain.
_OVERRUN = 0.05
_LEAST_OVERRUN_S = 0.5
# This part of the way, or this time, may lie between an order and the read that confirms it.
_BLUR = 0.05
_LEAST_BLUR_S = 0.5


class Way(Enum):
    """The direction of a movement."""

    OPENING = OPEN
    CLOSING = CLOSED

    @property
    def end(self) -> int:
        """Return the position at its end."""
        return self.value


class CoverMotion:
    """One cover. Its position is in percent; None: not known.

    The position is known after a movement to an end, and stays known over movements that were
    ordered here. It is not known after a start, unless the line before it left it standing, and
    after a movement by another master.

    Attributes:
        build: Its outputs and times, which a position is worth nothing without.
        way: The direction in which the motor runs, as ordered or read; None: it does not run.
        both: Both outputs are ON, which is never ordered here.
        unasked: The present movement was not ordered here, or not since the start.
        left: An earlier line could not stop it: if it is found running, it stops at once.
    """

    def __init__(self, config: CoverConfig) -> None:
        self.way: Way | None = None
        self.both = False
        self.unasked = False
        self.left = False
        self.build = f"{config.open} {config.open_s}, {config.close} {config.close_s}"
        self._bits = {Way.OPENING: bit(config.open), Way.CLOSING: bit(config.close)}
        self._travel_s = {Way.OPENING: config.open_s, Way.CLOSING: config.close_s}
        self._from: float | None = None  # position at rest, or at the beginning of the movement
        self._goal: float | None = None  # of the next order or the present movement; None: the end
        self._since = 0.0
        self._until = 0.0
        self._seen = False  # a read found it running
        self._off_at: float | None = None  # when it was first ordered OFF
        self._gap = False  # the module was away during the movement

    # --- where it is --------------------------------------------------------------------------

    def position(self, now: float) -> float | None:
        """Return the position, 0 closed to 100 open."""
        if self.way is None:
            return self._from
        if self._gap:
            return None
        way = (now - self._since) / self._travel_s[self.way] * 100
        if self._from is None:
            return float(self.way.end) if way >= OPEN else None
        if self.way is Way.OPENING:
            return min(self._from + way, float(OPEN))
        return max(self._from - way, float(CLOSED))

    @property
    def standing(self) -> float | None:
        """Return the position if it was read to stand there; None: it moves, or is not known."""
        return None if self.way is not None or self.both or self.left else self._from

    def recall(self, position: float) -> None:
        """Use the position of an earlier line; the first read that finds it moving drops it."""
        self._from = position

    def shown(self, now: float) -> tuple[CoverState, int | None]:
        """Return what is published: a movement only after a read found it (promise 5)."""
        if self.way is not None and self._seen:
            moving = CoverState.OPENING if self.way is Way.OPENING else CoverState.CLOSING
            return moving, _percent(self.position(now))
        match self._from:
            case None:
                return CoverState.STOPPED, None
            case 100.0:
                return CoverState.OPEN, OPEN
            case 0.0:
                return CoverState.CLOSED, CLOSED
        return CoverState.STOPPED, _percent(self._from)

    # --- what it should do --------------------------------------------------------------------

    def output(self, way: Way) -> int:
        """Return the output of one direction, as a bit."""
        return self._bits[way]

    def aim(self, goal: float | None) -> None:
        """Set the goal of the next order ON: None is the end of the way."""
        self._goal = goal

    def is_over(self, now: float) -> bool:
        """Return whether the motor has to be switched OFF."""
        return self.both or self.left or (self.way is not None and now >= self._until)

    @property
    def longest_s(self) -> float:
        """Return the longest time that a movement that was not ordered here may continue."""
        return 0.0 if self.way is None else self._until - self._since

    # --- what happens to it -------------------------------------------------------------------

    def ordered(self, mask: int, values: int, now: float) -> None:
        """Record that a frame with these orders is sent now: from now on it may be obeyed."""
        for way, output in self._bits.items():
            if values & output:
                if self.way is not way:
                    self._begin(way, now)
                self.unasked = False
                self._off_at = None
                self._until = self._since + self._run_s(way)
            elif mask & output and self.way is way and self._off_at is None:
                self._off_at = now

    def observe(self, outputs: int, now: float) -> None:
        """Use a confirmed read of the outputs."""
        running = [way for way, output in self._bits.items() if outputs & output]
        self.both = len(running) == len(self._bits)
        found = running[0] if len(running) == 1 else None
        if found is self.way:
            self._confirm(now)
        else:
            if self.way is not None:
                self._end(now)
            if found is not None:
                self._begin_unasked(found, now)
        if self.both:
            self._from = None
        self.left = False

    def lost(self) -> None:
        """Record that the module is away: it is not known whether the motor runs."""
        if self.way is not None:
            self._gap = True
            self._from = None

    # --- the inside ---------------------------------------------------------------------------

    def _begin(self, way: Way, now: float) -> None:
        self.way, self._since = way, now
        self._seen = self._gap = False
        self._off_at = None

    def _begin_unasked(self, way: Way, now: float) -> None:
        self._from = self._goal = None
        self._begin(way, now)
        self._seen = self.unasked = True
        self._until = now if self.left else now + self._run_s(way)

    def _confirm(self, now: float) -> None:
        if self.way is None:
            return
        if self._gap:
            self._gap, self._since = False, now  # `_until` stays: the motor may have run meanwhile
        elif not self._seen and self._blurred(now - self._since):
            self._from, self._since = None, now  # it may have started at any time since then
            self._goal = None
            self._until = now + self._run_s(self.way)
        self._seen = True

    def _end(self, now: float) -> None:
        self._from = self._stopped_at(now)
        self.way = self._goal = self._off_at = None
        self._seen = self._gap = self.unasked = False

    def _stopped_at(self, now: float) -> float | None:
        if not self._seen:  # it was ordered but never read ON
            return None if self._blurred(now - self._since) else self._from
        if self._off_at is None:
            return None  # another master switched it, at an unknown instant
        first, last = self.position(self._off_at), self.position(now)
        return first if first == last or not self._blurred(now - self._off_at) else None

    def _blurred(self, seconds: float) -> bool:
        return seconds > max(_BLUR * min(self._travel_s.values()), _LEAST_BLUR_S)

    def _run_s(self, way: Way) -> float:
        """Return how long the motor runs from the start of the movement."""
        travel_s, here, goal = self._travel_s[way], self._from, self._goal
        if here is not None and goal is not None and CLOSED < goal < OPEN:
            return travel_s * abs(goal - here) / 100
        # From the other end it runs the whole way: the position may be wrong.
        whole = here is None or here == way.end
        share = 1.0 if whole or here is None else abs(way.end - here) / 100
        return travel_s * share + max(_OVERRUN * travel_s, _LEAST_OVERRUN_S)


def _percent(position: float | None) -> int | None:
    """Return whole percent; 0 and 100 only at the ends."""
    if position is None:
        return None
    if position in {CLOSED, OPEN}:
        return int(position)
    return min(max(round(position), CLOSED + 1), OPEN - 1)
