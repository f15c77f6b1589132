"""Stale or false state by what happens on the wire: C1, C2, C6, C8.

All of it runs in virtual time: the real line worker and the real bus, the simulator's modules.
"""

import random
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from support.bus_worker import TURNAROUND_S, BusWorker, Script
from support.virtual_worker import make_line, make_station

from bridge.config.schema import LineConfig
from bridge.line.forecast import forecast
from bridge.model import (
    DIO100,
    DO100,
    LineEvent,
    LineProtocol,
    StationChanged,
    ValuesChanged,
    Writes,
)
from bridge.simulator.faults import FaultKind
from bridge.simulator.module import SimulatedModule
from proofs.figures import Figure, Run, Scale, proof
from proofs.judged_worker import JudgedWorker
from proofs.noisy_wire import NoisyWire

HOUR_S = 3600.0
OFFLINE_WITHIN_S = 5.0


def _seeded(seed: int) -> random.Random:
    return random.Random(seed)  # noqa: S311  # damage, not secrets


def _stations(count: int, protocol: LineProtocol) -> LineConfig:
    return make_line(*map(make_station, range(1, count + 1)), protocol=protocol)


# --- C1 ---------------------------------------------------------------------------------------


def _read_through_noise(protocol: LineProtocol, reads: int, rate: float) -> tuple[int, int, int]:
    """Returns how many reads there were, flipped bits, and false states."""
    chance = _seeded(1)
    worker = JudgedWorker(_stations(8, protocol), chance)
    noise = NoisyWire(worker.bus_line.conversation, rate, chance)
    worker.bus_line.conversation = noise  # type: ignore[assignment]  # as far as a port uses it
    worker.change()

    def stop_when_done() -> None:
        if worker.reads >= reads:
            worker.worker.stop()
        worker.line.at(worker.line.now + 1.0, stop_when_done)

    stop_when_done()
    worker.worker.work()
    return worker.reads, noise.flips, worker.false


@proof("C1")
def flipped_bits_become_no_states(run: Run) -> Figure:
    """Each bit of requests and replies may flip: hardly ever is a false value published."""
    reads = run.scale.of(2_000, 2_000_000)
    rate = run.scale.of(3, 1) / 10_000
    seen = {p: _read_through_noise(p, reads, rate) for p in LineProtocol}
    flips = sum(each[1] for each in seen.values())
    return Figure(
        injected=f"bit error rate {rate:g}, {reads} reads a protocol: {flips} flips",
        seen=", ".join(f"{protocol}: {each[2]}" for protocol, each in seen.items()) + " false",
        promised="at most 1 false state in a million reads",
        kept=flips > 0 and all(false * 1_000_000 <= made for made, _, false in seen.values()),
    )


# --- C2 ---------------------------------------------------------------------------------------

WAYS = (
    (LineProtocol.MODBUS_RTU, Writes.AUTO),
    (LineProtocol.MODBUS_ASCII, Writes.AUTO),
    (LineProtocol.WISCO, Writes.AUTO),
    (LineProtocol.WISCO, Writes.WISCO),
)

# A module that is the only one on its line, and has outputs alone, answers one kind of read: a
# late reply fits each of them.
LATE = ((DIO100, 0.02), (DO100, 0.02), (DO100, 0.3))


class _Followed(BusWorker):
    """Counts published outputs that turned to what the module is not.

    Attributes:
        turns: How often a published output changed.
        back: How often that was not what the module then had.
    """

    turns = 0
    back = 0
    _told = 0

    def report(self, event: LineEvent) -> None:
        """See `VirtualWorker`."""
        super().report(event)
        if isinstance(event, ValuesChanged):
            turned = event.outputs ^ self._told
            self._told = event.outputs
            self.turns += turned.bit_count()
            self.back += (turned & (event.outputs ^ self.line.modules[1].outputs)).bit_count()


def _write_at_any_moment(worker: BusWorker, count: int, chance: random.Random) -> Script:
    model = worker.line.modules[1].model
    for n in range(count):
        if model.inputs:
            worker.line.modules[1].toggle_input(chance.randint(1, model.inputs))
        yield chance.uniform(0.0, 0.15)
        bit = 1 << chance.randrange(model.outputs)
        yield worker.command(bit, 0 if worker.line.modules[1].outputs & bit else bit)
        if n % 100 == 0:
            yield 1.0  # a pause in which a state that is behind would be put right
    yield 1.0


@proof("C2")
def polls_do_not_undo_writes(run: Run) -> Figure:
    """Writes at any moment of the polls, replies lost or late: no output turns back."""
    count = run.scale.of(60, 2_500)
    chance = _seeded(2)
    turns = back = 0
    for (protocol, writes), (model, late) in product(WAYS, LATE):
        worker = _Followed(make_line(make_station(model=model), protocol=protocol, writes=writes))
        worker.bus_line.faults.set(FaultKind.SILENT, probability=0.02)
        worker.bus_line.faults.set(FaultKind.LATE, probability=late, delay_s=0.2)
        worker.follow(_write_at_any_moment(worker, count, chance))
        turns, back = turns + worker.turns, back + worker.back
    total = count * len(WAYS) * len(LATE)
    return Figure(
        injected=f"{total} writes at any moment of the polls, 2-30 % of replies late",
        seen=f"{turns} published turns of outputs, {back} of them back",
        promised="0 flips back",
        # Late replies look like another master's (F12): a change takes reads apart, and a relay may
        # have turned again by then.
        kept=back == 0 and turns >= total * 0.7,
    )


# --- C6 ---------------------------------------------------------------------------------------


def _lose(worker: BusWorker) -> None:
    """5 % of the exchanges: half of them before the module heard, half after it answered."""
    worker.bus_line.faults.set(FaultKind.DEAF, probability=0.025)
    worker.bus_line.faults.set(FaultKind.SILENT, probability=0.0256)


def _deaths(worker: BusWorker, count: int, chance: random.Random) -> Iterator[float]:
    """Stations leave the line and come back; yields how long each was still called online."""
    died: list[tuple[str, float]] = []

    def script() -> Script:
        yield 45.0  # everybody was met by then, in spite of the loss
        for _ in range(count):
            address = chance.randint(1, len(worker.line.modules))
            died.append((f"s{address}", worker.line.now))
            worker.line.modules[address].away = True
            yield 2 * OFFLINE_WITHIN_S
            worker.line.modules[address].away = False
            yield 45.0  # it was probed again by then

    worker.follow(script())
    for station_id, at in died:
        gone = (t for t, online in worker.online_at(station_id) if not online and t >= at)
        yield next(gone, float("inf")) - at


@proof("C6")
def a_lossy_line_does_not_flap(run: Run) -> Figure:
    """Random loss takes no module offline; a dead one is, soon, in spite of the loss."""
    seconds, deaths = run.scale.of(30, int(HOUR_S)), run.scale.of(1, 20)
    chance = _seeded(6)
    flips = 0
    slowest: list[float] = []
    for protocol in LineProtocol:
        worker = BusWorker(_stations(8, protocol), seed=6)
        _lose(worker)
        worker.run(worker.line.now + seconds)
        flips += sum(isinstance(e, StationChanged) and not e.online for e in worker.reported())
        dying = BusWorker(_stations(8, protocol), seed=7)
        _lose(dying)
        slowest += _deaths(dying, deaths, chance)
        # The fullest line, whose rounds are the longest; it loses nothing besides.
        if run.scale is Scale.FULL or protocol is LineProtocol.MODBUS_RTU:
            slowest += _deaths(BusWorker(_stations(31, protocol)), deaths, chance)
    return Figure(
        injected=f"5 % random loss for {seconds} s; {len(slowest)} dead stations (of 8, of 31)",
        seen=f"{flips} flips; dead offline within {max(slowest):.1f} s",
        promised=f"0 flips; dead offline within {OFFLINE_WITHIN_S:.0f} s",
        kept=flips == 0 and max(slowest) <= OFFLINE_WITHIN_S,
    )


# --- C8 ---------------------------------------------------------------------------------------


def _pulses(worker: BusWorker, count: int, bound_s: float, chance: random.Random) -> Script:
    modules = [m for m in worker.line.modules.values() if m.model is DIO100]
    for _ in range(count):
        module, channel = chance.choice(modules), chance.randint(1, DIO100.inputs)
        module.set_input(channel, True)
        yield chance.uniform(1.0, 1.25) * bound_s
        module.set_input(channel, False)
        yield chance.uniform(1.0, 2.0) * bound_s


def _turns_of_inputs(worker: BusWorker, module: SimulatedModule) -> int:
    turns, before = 0, 0
    for event in worker.reported():
        if isinstance(event, ValuesChanged) and event.station_id == f"s{module.address}":
            turns += (event.inputs ^ before).bit_count()
            before = event.inputs
    return turns


@proof("C8")
def short_pulses_are_seen(run: Run) -> Figure:
    """A pulse as long as the bound of the inputs that `check` prints is published, both edges."""
    count = run.scale.of(40, 2_000)
    chance = _seeded(8)
    seen, total, bounds_ms = 0, 0, []
    for protocol in LineProtocol:
        for stations in (
            [make_station(1)],
            [make_station(n, DO100 if n % 4 == 0 else DIO100) for n in range(1, 9)],
        ):
            config = replace(make_line(*stations, protocol=protocol), turnaround_s=TURNAROUND_S)
            bound_s = max(forecast(config).inputs_s.values())
            bounds_ms.append(bound_s * 1000)
            worker = BusWorker(config)
            worker.follow(_pulses(worker, count, bound_s, chance))
            turns = sum(_turns_of_inputs(worker, m) for m in worker.line.modules.values())
            seen, total = seen + turns, total + 2 * count
    bounds = f"{min(bounds_ms):.0f}-{max(bounds_ms):.0f} ms"
    return Figure(
        injected=f"{total // 2} pulses of 1-1.25 bounds ({bounds})",
        seen=f"{seen} of {total} edges published",
        promised="all",
        kept=seen == total,
    )
