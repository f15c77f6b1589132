"""Motors: F1 and F2 the stop of a line, F3 a motor at a silent module, F14 the longest timings."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from math import inf
from typing import Self

from support.moving_line import MET_BY_S, MOVE_AT_S, MovingLine, moving_line, moving_station
from support.virtual_worker import make_station

from bridge.config.lines import LONGEST_EXCHANGE_S
from bridge.config.schema import LineConfig, OutputConfig
from bridge.daemon import app
from bridge.drivers import driver_for
from bridge.model import DIO100, DO100, Command, CoverCommand, LineProtocol
from bridge.simulator.module import SimulatedModule
from proofs.figures import Figure, Run, Scale, proof

PROTOCOLS = list(LineProtocol)

# --- F1 ---------------------------------------------------------------------------------------

LIVE_WITHIN_S = 3.0
TIMEOUTS = (None, 1.0)
LIVE = (1, 2, 3)  # of three modules: the dead ones stand behind it, at both sides, before it
# How long they were silent when the stop came: not noticed yet, suspected, offline, forgotten.
SILENT_S = (0.0, 0.07, 0.15, 0.31, 0.6, 1.1, 1.7, 2.3, 3.1, 4.7, 8.2, 20.0, 61.3)
WAYS_S = (300.0, 9.0)  # the latter is over when the stop comes late: something is due there


@dataclass(frozen=True, slots=True)
class _Stop:
    """What came of one stop.

    Attributes:
        left: Motors of dead modules that run on.
        unnamed: Of these, how many the log does not name.
    """

    live_off_s: float
    ended_s: float
    left: int
    unnamed: int
    fails: bool
    sign_of_life_s: float

    @property
    def kept(self) -> bool:
        """Whether the live motors stand in time, and the others were named."""
        return (
            self.live_off_s <= LIVE_WITHIN_S
            and self.ended_s <= app._COVERS_STOP_S
            and self.unnamed == 0
            and self.fails
            and self.sign_of_life_s < app._STUCK_AFTER_S
        )


class _Log(logging.Handler):
    """Collects what the lines log at level ERROR, and keeps it out of other logs."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Takes one line."""
        self.lines.append(record.getMessage())

    def __enter__(self) -> Self:
        logger = logging.getLogger("bridge.line")
        logger.addHandler(self)
        logger.propagate = False
        return self

    def __exit__(self, *_: object) -> None:
        logger = logging.getLogger("bridge.line")
        logger.removeHandler(self)
        logger.propagate = True


def _stop(config: LineConfig, live: int, silent_s: float, *, commands: bool) -> _Stop:
    """All motors run; all modules but one fall silent, and `silent_s` later the line is to end."""
    worker = MovingLine(config)
    dead = [address for address in worker.line.modules if address != live]
    stop_at = MET_BY_S + silent_s
    worker.away_at(MET_BY_S, dead)
    if commands:  # each is 2 s on its way when nothing is done about it
        for n, address in enumerate(dead):
            worker.line.at(stop_at - 0.05 - 0.2 * n, partial(_stop_cover, worker, address))
    worker.watch(stop_at + app._COVERS_STOP_S)
    with _Log() as log:
        worker.run(stop_at)
    off_at = worker.off_at(live)
    left = worker.covers_on(dead)
    return _Stop(
        live_off_s=inf if off_at is None else off_at - stop_at,
        ended_s=worker.line.now - stop_at,
        left=len(left),
        unnamed=sum(not any(cover in line for line in log.lines) for cover in left),
        fails=bool(worker.worker.moving) or not left,
        sign_of_life_s=worker.longest_silence_s,
    )


def _stop_cover(worker: MovingLine, address: int) -> None:
    now = worker.line.now
    worker.worker.submit(
        CoverCommand(
            f"s{address}", "cover/c1", "STOP", "c1", 0b11, None, arrived=now, deadline=now + 2.0
        )
    )


def _stops(scale: Scale) -> Iterator[_Stop]:
    silences = SILENT_S if scale is Scale.FULL else SILENT_S[3:8:4]
    ways = WAYS_S if scale is Scale.FULL else WAYS_S[:1]
    lives = LIVE if scale is Scale.FULL else LIVE[2:]
    for protocol, timeout_s, live, way_s in product(PROTOCOLS, TIMEOUTS, lives, ways):
        stations = [
            moving_station(a, DIO100, WAYS_S[0]) if a == live else moving_station(a, DO100, way_s)
            for a in LIVE
        ]
        config = moving_line(stations, protocol, timeout_s)
        for silent_s, commands in product(silences, (False, True)):
            yield _stop(config, live, silent_s, commands=commands)


@proof("F1")
def dead_modules_keep_no_live_motor_on(run: Run) -> Figure:
    """Sixteen covers of dead modules beside it: the live one is stopped first."""
    stops = list(_stops(run.scale))
    return Figure(
        injected=f"{len(stops)} stops of a line with 16 covers at dead modules, 3 protocols",
        seen=f"live OFF in {max(s.live_off_s for s in stops):.2f} s, ended in "
        f"{max(s.ended_s for s in stops):.1f} s; {sum(s.unnamed for s in stops)} of "
        f"{sum(s.left for s in stops)} others not named",
        promised=f"within {LIVE_WITHIN_S:.0f} s, all others named",
        kept=all(s.kept for s in stops) and sum(s.left for s in stops) > 0,
    )


# --- F2 ---------------------------------------------------------------------------------------

HANG_UPS_S = (0.2, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
BEFORE_S = (-0.03, 0.0, 0.013, 0.3)  # the port goes so long before the stop, or in its middle


def _hang_up(config: LineConfig, hang_up_s: float, before_s: float) -> tuple[float | None, float]:
    """When the motors stood after the port was back (None: one runs), and when the line ended."""
    worker = MovingLine(config)
    back_at = MET_BY_S + hang_up_s
    worker.line.at(MET_BY_S, lambda: setattr(worker.bus_line, "hung_up", True))
    worker.line.at(back_at, lambda: setattr(worker.bus_line, "hung_up", False))
    stop_at = MET_BY_S + before_s
    worker.run(stop_at)
    offs = [worker.off_at(address) for address in worker.line.modules]
    off_s = None if None in offs else max(at - back_at for at in offs if at is not None)
    return off_s, worker.line.now - stop_at


@proof("F2")
def the_port_hangs_up_at_the_stop(run: Run) -> Figure:
    """It is opened again while a motor may run and time is left."""
    count = run.scale.of(2, len(HANG_UPS_S))
    seen = []
    for protocol, hang_up_s, before_s in product(PROTOCOLS, HANG_UPS_S[-count:], BEFORE_S):
        stations = [moving_station(1, DIO100), moving_station(2, DO100)]
        seen.append(_hang_up(moving_line(stations, protocol), hang_up_s, before_s))
    offs = [off_s for off_s, _ in seen if off_s is not None]
    return Figure(
        injected=f"{len(seen)} hang-ups of 0.2-3 s around a stop",
        seen=f"{len(offs)} of {len(seen)} times all motors OFF, {max(offs, default=0.0):.2f} s "
        f"after the port was back; ended within {max(ended for _, ended in seen):.1f} s",
        promised="OFF whenever the port came back in time",
        kept=len(offs) == len(seen) and max(e for _, e in seen) <= app._COVERS_STOP_S,
    )


# --- F3 ---------------------------------------------------------------------------------------

OFF_AFTER_RETURN_S = 1.5
NEIGHBOUR_WITHIN_S = 1.0
SILENCE_S = 65.0
WAY_S = 4.0
PHASES = 20


def _late_motor(protocol: LineProtocol, others: int, phase_s: float) -> tuple[float, float]:
    """How long after its return the motor stood, and the longest pause at a neighbour."""
    stations = [
        moving_station(1, DIO100, WAY_S, most=1),
        *(make_station(a + 2) for a in range(others)),
    ]
    worker = MovingLine(moving_line(stations, protocol))
    back_at = MET_BY_S + SILENCE_S + phase_s
    worker.away_at(MOVE_AT_S + 2.5, [1])
    worker.away_at(back_at, [1], away=False)
    worker.run(back_at + 35.0)
    off_at = worker.off_at(1)
    return inf if off_at is None else off_at - back_at, _longest_pause_s(worker, back_at)


def _longest_pause_s(worker: MovingLine, until: float) -> float:
    """Between two reads of the module next to the silent one, when that is known to be away."""
    if 2 not in worker.line.modules:
        return 0.0
    frame = driver_for(worker.config.protocol, 2, DIO100).read_inputs.frame
    reads = [at for at, sent in worker.line.wire if sent == frame and MET_BY_S + 10 < at < until]
    return max(after - at for at, after in pairwise(reads))


def _late_max_on(protocol: LineProtocol, phase_s: float) -> float:
    """The same with `max_on` in place of a cover."""
    config = make_station(1, outputs=(OutputConfig(1, mode="latch", max_on_s=WAY_S),))
    worker = MovingLine(moving_line([config, make_station(2)], protocol))
    worker.line.at(MET_BY_S, lambda: worker.worker.submit(_on(worker, worker.line.modules[1])))
    back_at = MET_BY_S + SILENCE_S + phase_s
    worker.away_at(MET_BY_S + 2.0, [1])
    worker.away_at(back_at, [1], away=False)
    worker.run(back_at + 35.0)
    off_at = [s.at for s in worker.line.modules[1].switchings if s.output == 1 and not s.value]
    return off_at[-1] - back_at if off_at else inf


def _on(worker: MovingLine, module: SimulatedModule) -> Command:
    now = worker.line.now
    return Command(f"s{module.address}", "do/1", "ON", 1, 1, None, arrived=now, deadline=now + 2.0)


@proof("F3")
def a_motor_at_a_module_that_is_back_after_a_minute(run: Run) -> Figure:
    """What is due there goes out at once: it is looked for each second."""
    phases = [n / PHASES for n in range(0, PHASES, run.scale.of(PHASES, 1))]
    neighbours = (0, 3)[run.scale.of(1, 0) :]
    seen = [_late_motor(*case) for case in product(PROTOCOLS, neighbours, phases)]
    covers = [off_s for off_s, _ in seen]
    pause_s = max(pause_s for _, pause_s in seen)
    limits = [_late_max_on(protocol, phase_s) for protocol, phase_s in product(PROTOCOLS, phases)]
    return Figure(
        injected=f"{len(covers)} covers and {len(limits)} max_on, silent for 65 s",
        seen=f"OFF {max(covers):.2f} s and {max(limits):.2f} s after the return; "
        f"a neighbour read each {pause_s:.2f} s",
        promised=f"within {OFF_AFTER_RETURN_S} s, neighbours within {NEIGHBOUR_WITHIN_S} s",
        kept=max(*covers, *limits) <= OFF_AFTER_RETURN_S and pause_s <= NEIGHBOUR_WITHIN_S,
    )


# --- F14 --------------------------------------------------------------------------------------


def _slowest(protocol: LineProtocol) -> list[LineConfig]:
    """The longest timings that a configuration may have."""
    stations = [moving_station(1, DIO100), moving_station(2, DO100), moving_station(3, DO100)]
    line = moving_line(stations, protocol)
    most = LONGEST_EXCHANGE_S
    return [
        replace(line, timeout_s=most - 0.3),
        replace(line, timeout_s=most / 2, late_window_s=most / 2),
        replace(line, timeout_s=0.5, late_window_s=most - 0.5),
        replace(line, turnaround_s=7.0, late_window_s=10.0),
        replace(line, timeout_s=5.0, silence_s=10.0, late_window_s=5.0),
    ]


def _sign_of_life_s(config: LineConfig, seconds: float) -> float:
    """The longest time without one, with two of three modules dead, commands, and a stop."""
    worker = MovingLine(config)
    begun = worker.line.now
    worker.away_at(begun + 30.0, [2, 3])
    for n in range(int(seconds / 10)):
        worker.line.at(begun + 10.0 * n, partial(_stop_cover, worker, 1 + n % 3))
    worker.watch(begun + seconds + 60.0, every_s=0.5)
    worker.run(begun + seconds)
    return worker.longest_silence_s


@proof("F14")
def the_longest_timings(run: Run) -> Figure:
    """A thread that waits as long as it was told to is not stuck."""
    seconds = run.scale.of(50, 1200)
    longest = [_sign_of_life_s(config, seconds) for p in PROTOCOLS for config in _slowest(p)]
    return Figure(
        injected=f"{len(longest)} lines with the longest timings, {seconds} s, 2 of 3 dead",
        seen=f"a sign of life every {max(longest):.1f} s at least",
        promised=f"none is longer than {app._STUCK_AFTER_S:.0f} s, which counts as stuck",
        kept=max(longest) < app._STUCK_AFTER_S,
    )
