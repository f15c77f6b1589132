"""Found by trying: F16 what flaps for a day does not fill the log, whatever it is."""

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from bridge.bounded_log import MOST_LINES_AN_HOUR, Cause
from proofs import flaps_line, flaps_mqtt, flaps_web
from proofs.figures import Figure, Run, Scale, proof
from proofs.flapping import Flap, counted

# Who makes each cause come and go. A cause that is not here is not proved, and F16 fails.
SCENARIOS: dict[Cause, Callable[[Flap], None]] = {
    Cause.BROKER_CONNECTION: flaps_mqtt.connection,
    Cause.BROKER_DENIES: flaps_mqtt.denials,
    Cause.BROKER_STALE: flaps_mqtt.stale,
    Cause.PORT: flaps_line.port,
    Cause.STATION: flaps_line.modules,
    Cause.SETTINGS: flaps_line.modules,
    Cause.STRAYS: flaps_line.modules,
    Cause.UNASKED: flaps_line.modules,
    Cause.MOTOR: flaps_line.motor,
    Cause.COMMAND: flaps_mqtt.commands,
    Cause.UNKNOWN_STATION: flaps_mqtt.commands,
    Cause.OWN_ORDER: flaps_line.modules,
    Cause.REQUEST: flaps_mqtt.commands,
    Cause.RELOAD: flaps_mqtt.reloads,
    Cause.LEFTOVERS: flaps_mqtt.leftovers,
    Cause.MESSAGE: flaps_mqtt.messages,
    Cause.VERDICTS: flaps_mqtt.verdicts,
    Cause.DISK: flaps_mqtt.disk,
    Cause.CLOCK: flaps_mqtt.suspends,
    Cause.PANEL: flaps_web.listening,
}
PERIODS_S = {Scale.SHORT: (60.0,), Scale.FULL: (0.5, 1.0, 3.0, 7.0, 20.0, 60.0)}


def _flap(period_s: float, hours: int) -> tuple[Counter[Cause], list[str]]:
    """Run every scenario; return the worst hour of each cause, and what was logged unbounded."""
    worst: Counter[Cause] = Counter()
    unbounded: list[str] = []
    for scenario in dict.fromkeys(SCENARIOS.values()):
        flap = Flap(period_s, hours)
        with counted(flap) as count:
            scenario(flap)
        unbounded += count.unbounded
        for cause, lines in count.worst_hours():
            worst[cause] = max(worst[cause], lines)
    return worst, unbounded


def _flaps(run: Run, hours: int) -> Iterator[tuple[Counter[Cause], list[str]]]:
    """Run all periods: a day at each takes a minute, so two at a time."""
    periods = PERIODS_S[run.scale]
    if run.scale is Scale.SHORT:
        yield from (_flap(period_s, hours) for period_s in periods)
        return
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_flap, periods, [hours] * len(periods))


@proof("F16")
def every_cause_flaps(run: Run) -> Figure:
    """Each cause that the code knows has at most 20 lines in any hour, at any period."""
    hours = run.scale.of(2, 24)
    worst: Counter[Cause] = Counter()
    unbounded: list[str] = []
    for lines, past in _flaps(run, hours):
        worst |= lines  # the larger of both
        unbounded += past
    unproved = [cause.name for cause in Cause if cause not in SCENARIOS or not worst[cause]]
    each = ", ".join(f"{cause.name.lower()} {worst[cause]}" for cause in Cause)
    most, periods = max(worst.values()), len(PERIODS_S[run.scale])
    return Figure(
        injected=f"{len(Cause)} causes, each flapping for {hours} h at {periods} periods",
        seen=f"at most {most} lines in any hour ({each})"
        + (f"; not proved: {', '.join(unproved)}" if unproved else "")
        + (f"; past the bounded log: {unbounded[0]}" if unbounded else ""),
        promised=f"at most {MOST_LINES_AN_HOUR} lines an hour each",
        kept=most <= MOST_LINES_AN_HOUR and not unproved and not unbounded,
    )
