"""What relays may do besides commands: the configured rules, and what must never happen.

No I/O and no threads here. Instants are of `time.monotonic`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from bridge.simulator.module import Switching
from soak.disturbances import Disturbances

# From when an order is due until the relay obeys it, beside neighbours that answer late.
BOUND_S = 2.0
SWEEP_S = 2.0  # `output_sweep`: so late the bridge may find what a hand switched ON
# The longest pause after an order that failed (docs/safety.md), and one for a line to come back.
MOTOR_PAUSE_S, MAX_ON_PAUSE_S = 5.0 + 2.0, 30.0 + 2.0
STOPPED_WITHIN_S = 3.0
BLUR_S = 0.3  # between two processes on a busy computer
SEEN_S = 1.0  # what a hand did less long ago, a read may have missed
GAP_S = 0.3  # an output that was OFF for less may not have been read so


class Move(NamedTuple):
    """A relay obeyed.

    Attributes:
        pulse: By the settings of the module itself its output was a pulse then.
    """

    station_id: str
    switching: Switching
    pulse: bool = False


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules of the outputs, the same at every module."""

    pulses: frozenset[int] = frozenset()
    longest_hold_s: float = 1.0
    read_only: int = 0
    motors: frozenset[int] = frozenset()
    way_s: float = 0.0
    max_on: int = 0
    max_on_s: float = 0.0
    on_loss: int = 0
    after_s: float = 0.0
    groups: tuple[tuple[int, ...], ...] = ()
    dead_time_s: float = 0.0


@dataclass(slots=True)
class Run:
    """An output that is ON.

    Attributes:
        since: When it went ON.
        for_long: The same, but for pauses that the bridge may not have seen.
        frame_at: When a frame told it ON last; None: a hand did it.
        told: What is wrong with it and was told.
    """

    since: float
    for_long: float
    frame_at: float | None
    told: set[str] = field(default_factory=set)


Key = tuple[str, int]  # a station, and an output


class Relays:
    """Follows every relay of the house."""

    def __init__(
        self, rules: Rules, disturbances: Disturbances, harm: Callable[[str, str], None]
    ) -> None:
        self._rules = rules
        self._disturbances = disturbances
        self._harm = harm
        self._on: dict[Key, Run] = {}
        self._last: dict[Key, tuple[Run, float]] = {}  # the run before, and its end
        self._hands: dict[Key, float] = {}
        self._lost: dict[str, float] = {}  # by station the loss that `on_loss` had its order for

    # --- what happens -------------------------------------------------------------------------

    def take(self, move: Move) -> None:
        """Follow one relay; in their order."""
        key = move.station_id, move.switching.output
        if not move.switching.frame:
            self._hands[key] = move.switching.at
        if move.switching.value:
            self._goes_on(key, move.switching)
        elif key in self._on:
            run = self._on.pop(key)
            self._last[key] = run, move.switching.at
            self._judge(key, run, move.switching.at)

    def look(self, now: float) -> None:
        """Judge what is ON, and goes on being so."""
        for key, run in self._on.items():
            self._judge(key, run, now)

    def forget_losses(self) -> None:
        """The daemon ended: another one knows nothing of what was done in a loss."""
        self._lost.clear()

    # --- what may be --------------------------------------------------------------------------

    def moving(self) -> list[Key]:
        """Return the motors that run."""
        return [key for key in self._on if key[1] in self._rules.motors]

    def rule(self, move: Move, loss_began: float, awake_s: float) -> str | None:
        """Name the rule that switches this without a command; None: there is none.

        Args:
            move: Not yet taken.
            loss_began: When the bridge was heard last before.
            awake_s: What its clock counts since then.
        """
        output, value = move.switching.output, move.switching.value
        if output in self._rules.motors and not value:
            return "cover"
        if output == self._rules.max_on and not value and self._was_on_for_long(move):
            return "max_on"
        if output == self._rules.on_loss and value and awake_s >= self._rules.after_s - BLUR_S:
            self._once_a_loss(move, loss_began)
            return "on_loss"
        return None

    def hand_before(self, move: Move) -> bool:
        """Tell whether a hand, or the end of a pulse, came between a read and a write of gaps."""
        at = self._hands.get((move.station_id, move.switching.output))
        mine = move.switching.output != self._rules.read_only and not move.pulse
        return mine and at is not None and move.switching.at - at <= SEEN_S

    def _was_on_for_long(self, move: Move) -> bool:
        run = self._on.get((move.station_id, move.switching.output))
        if run is None:
            return False
        if move.switching.at - run.for_long >= self._rules.max_on_s - BLUR_S:
            return True
        # Not heard of, it counts as ON all the time.
        return not self._disturbances.quiet(move.station_id, run.since - BOUND_S, move.switching.at)

    def _once_a_loss(self, move: Move, loss_began: float) -> None:
        before = self._lost.get(move.station_id)
        self._lost[move.station_id] = loss_began
        if before == loss_began and self._disturbances.quiet(
            move.station_id, loss_began, move.switching.at
        ):
            self._harm("on_loss twice in a loss", f"{move}")

    # --- what never may be --------------------------------------------------------------------

    def _goes_on(self, key: Key, switching: Switching) -> None:
        at = switching.at
        run = self._on.get(key)
        if run is None:
            run = self._on[key] = Run(at, self._for_long(key, at), None)
        if switching.frame:
            self._clash(key, at)
            run.frame_at = at

    def _for_long(self, key: Key, at: float) -> float:
        run, off_at = self._last.get(key, (None, 0.0))
        hidden = off_at == self._hands.get(key) and at - off_at <= SWEEP_S + BLUR_S
        return run.for_long if run and (hidden or at - off_at <= GAP_S) else at

    def _clash(self, key: Key, at: float) -> None:
        station_id, output = key
        for other in self._others(output):
            run = self._on.get((station_id, other))
            last, off_at = self._last.get((station_id, other), (None, 0.0))
            if run is not None and (run.frame_at is not None or at - run.since > SEEN_S):
                self._harm(
                    "interlocked outputs ON together", f"{station_id} {output}, {other}: {run}"
                )
            elif last and last.frame_at and at - off_at < self._rules.dead_time_s - 0.02:
                text = f"{station_id} {output}, {at - off_at:.3f} s after {other}"
                self._harm("dead times cut short", text)

    def _others(self, output: int) -> Iterator[int]:
        for group in self._rules.groups:
            if output in group:
                yield from (other for other in group if other != output)

    def _judge(self, key: Key, run: Run, until: float) -> None:
        output = key[1]
        if output in self._rules.pulses and run.frame_at is not None:
            if until - run.frame_at > self._rules.longest_hold_s + BLUR_S:
                self._tell("pulses that left a relay ON", key, run, until)
        elif output in self._rules.motors:
            self._judge_long(key, run, until, self._rules.way_s, MOTOR_PAUSE_S)
            self._judge_stop(key, run, until)
        elif output == self._rules.max_on:
            self._judge_long(key, run, until, self._rules.max_on_s, MAX_ON_PAUSE_S)

    def _judge_long(self, key: Key, run: Run, until: float, limit_s: float, pause_s: float) -> None:
        station_id = key[0]
        if run.frame_at is None or key[1] == self._rules.max_on:
            limit_s += SWEEP_S
        disturbed = not self._disturbances.quiet(station_id, run.since - BOUND_S, until)
        if disturbed or self._disturbances.anew(station_id, run.since - BOUND_S, until):
            limit_s += pause_s
        if self._disturbances.longest_quiet_s(station_id, run.since, until) > limit_s + BOUND_S:
            self._tell("motors and max_on outputs ON too long", key, run, until)

    def _judge_stop(self, key: Key, run: Run, until: float) -> None:
        for at in self._disturbances.anew(key[0], run.since, until):
            latest = at + STOPPED_WITHIN_S + BLUR_S
            if until > latest and self._disturbances.quiet(key[0], at - BOUND_S, latest):
                self._tell("motors that a stop or reload left ON for 3 s", key, run, until)

    def _tell(self, name: str, key: Key, run: Run, until: float) -> None:
        if name not in run.told:
            run.told.add(name)
            self._harm(name, f"{key[0]} output {key[1]}, at {until:.3f}: {run}")
