"""A relay switched wrongly by what happens on the wire: A5, A6, A8, A12.

All of it runs in virtual time: the real line worker and the real bus, the simulator's modules.
"""

import random
from collections.abc import Iterator
from itertools import pairwise

from support.bus_worker import BusLine, BusWorker, Script
from support.virtual_worker import make_line, make_station

from bridge.config.schema import LineConfig
from bridge.drivers import driver_for
from bridge.errors import ExchangeError
from bridge.model import DIO100, DO100, LineProtocol, Reason, Status, Verdict, Word, Writes
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.module import SimulatedModule
from proofs.figures import Figure, Run, proof

# A line's protocol, and the frames in which it is written: every way in which an output is set.
WAYS = (
    (LineProtocol.MODBUS_RTU, Writes.AUTO),
    (LineProtocol.MODBUS_ASCII, Writes.AUTO),
    (LineProtocol.WISCO, Writes.AUTO),
    (LineProtocol.WISCO, Writes.WISCO),
)
MODULES = 32
READ_BACKS = 3  # after a write its output is read so often at the most


def _lines() -> Iterator[LineConfig]:
    for protocol, writes in WAYS:
        yield make_line(make_station(1), make_station(2, DO100), protocol=protocol, writes=writes)


def _count(verdicts: list[Verdict], status: Status) -> int:
    return sum(verdict.status is status for verdict in verdicts)


# --- A5 ---------------------------------------------------------------------------------------


class _LostReplies:
    """Strikes the reply to each write, and to the reads after one half of them."""

    def __init__(self) -> None:
        self._writes = 0
        self._reads_left = 0

    def __call__(self, frame: bytes) -> bool:
        if is_write(frame):
            self._writes += 1
            self._reads_left = READ_BACKS if self._writes % 4 < 2 else 0
            return True
        self._reads_left -= 1
        return self._reads_left >= 0


def _presses(worker: BusWorker, count: int) -> Script:
    for n in range(count):
        bit = 1 << n % DIO100.outputs
        yield 0.2
        if n % 4 < 2:
            yield worker.command(bit, bit, word=Word.PRESS)
        else:
            yield worker.command(bit, bit)


@proof("A5")
def replies_to_pulses_are_lost(run: Run) -> Figure:
    """Each pulse goes out once, whatever is not heard of it."""
    count = run.scale.of(25, 1000)
    orders, done, verdicts = [], 0, 0
    for config in _lines():
        worker = BusWorker(config)
        for output in range(1, DIO100.outputs + 1):
            # The short ones are over before anybody can look: they read as if nothing was done.
            hold_s = 0.1 if output % 2 else 0.5
            worker.line.modules[1].set_mode(output, pulse=True, hold_s=hold_s)
        worker.bus_line.faults.set(FaultKind.SILENT, only=_LostReplies())
        worker.follow(_presses(worker, count))
        ordered = worker.line.modules[1].ordered
        orders.append(sum(ordered.values()))
        assert all(value for _, value in ordered), "OFF was not asked for"
        done += _count(worker.verdicts(), Status.DONE)
        verdicts += len(worker.verdicts())
    return Figure(
        injected=f"{count} pulses in each of {len(WAYS)} ways, every reply lost",
        seen=f"{' + '.join(map(str, orders))} ONs on the wire, {done} done",
        promised="as many ONs as pulses, 0 done",
        kept=orders == [count] * len(WAYS) and not done and verdicts == count * len(WAYS),
    )


# --- A6 ---------------------------------------------------------------------------------------


def _writes_behind_an_echo(worker: BusWorker, count: int, *, dead: bool) -> Script:
    module = worker.line.modules[1]
    for n in range(count):
        bit = 1 << n % DIO100.outputs
        mask = bit if n % 4 else bit | 1 << (n + 3) % DIO100.outputs
        values = 0 if n & DIO100.outputs else mask
        module.away = dead
        yield worker.command(mask, values)
        module.away = False
        yield 0.6  # more than one round: the other module and this one are read again


@proof("A6")
def an_echo_is_no_acknowledgement(run: Run) -> Figure:
    """With an echoing adapter nothing is `done` without a module, and all is with one."""
    count = run.scale.of(25, 1000)
    done = {True: 0, False: 0}
    sent, switched = dict.fromkeys(done, 0), dict.fromkeys(done, 0)
    for config in _lines():
        for dead in done:
            worker = BusWorker(config)
            worker.bus_line.faults.set(FaultKind.ECHO)
            worker.follow(_writes_behind_an_echo(worker, count, dead=dead))
            assert worker.bus_line.bus.echo, "the line was to echo"
            done[dead] += _count(worker.verdicts(), Status.DONE)
            sent[dead] += sum(verdict.status is not Status.REFUSED for verdict in worker.verdicts())
            switched[dead] += sum(worker.line.modules[1].ordered.values())
    total = count * len(WAYS)
    return Figure(
        injected=f"echo, station dead / alive, {count} writes in each of {len(WAYS)} ways",
        seen=f"dead: {done[True]} of {sent[True]} done; alive: {done[False]} of {sent[False]}",
        promised="dead: 0 done; alive: all done",
        kept=(done[True], done[False], sent[True], sent[False]) == (0, total, total, total)
        and switched[True] == 0 < total <= switched[False],
    )


# --- A8 ---------------------------------------------------------------------------------------


def _late_polls(config: LineConfig, polls: int, chance: random.Random) -> tuple[int, int, int]:
    """Polls all stations in turn; returns replies taken, those late, those of another station."""
    line = BusLine(config)
    bus = line.open(config)
    reads = []
    for address, module in line.modules.items():
        # No two stations say the same, neither in their inputs nor in their outputs.
        for channel in range(1, DIO100.inputs + 1):
            module.set_input(channel, bool((address * 0x0801) >> (channel - 1) & 1))
        for channel in range(1, DIO100.outputs + 1):
            module.set_output(channel, bool(address >> (channel - 1) & 1))
        driver = driver_for(config.protocol, address, DIO100)
        reads += [(driver.read_inputs, module.inputs), (driver.read_outputs, module.outputs)]
    good = wrong = 0
    for n in range(polls):
        request, truth = reads[n % len(reads)]
        if chance.random() < 0.002:
            delay_s = 0.11 + chance.random() * (config.late_window_s - 0.02)
            line.faults.set(FaultKind.LATE, times=1, delay_s=delay_s)
        try:
            value = bus.exchange(request, protected=config.protocol is not LineProtocol.WISCO)
        except ExchangeError:
            continue
        good += 1
        wrong += value != truth
    return good, line.faults.struck[FaultKind.LATE], wrong


@proof("A8")
def late_replies_are_nobodys(run: Run) -> Figure:
    """A reply that comes after its time-out is not taken for the next station's."""
    polls = run.scale.of(2000, 100_000)
    chance = random.Random(8)  # noqa: S311  # damage, not secrets
    good = late = wrong = 0
    for protocol in LineProtocol:
        first = 0 if protocol is LineProtocol.WISCO else 1
        stations = [make_station(address) for address in range(first, MODULES)]
        counts = _late_polls(make_line(*stations, protocol=protocol), polls, chance)
        good, late, wrong = good + counts[0], late + counts[1], wrong + counts[2]
    return Figure(
        injected=f"{polls} polls in each protocol, {late} late in the window",
        seen=f"{wrong} of {good} replies given to the wrong station",
        promised="0 given to the wrong station",
        kept=wrong == 0 and late > 0 and good > polls,
    )


# --- A12 --------------------------------------------------------------------------------------

GATE = 4  # the pulse output, with a neighbour on each side
HOLD_S = 1.0


def _around_a_pulse(worker: BusWorker, count: int, chance: random.Random) -> Script:
    """Starts a pulse, and writes its neighbours at any moment of it: singly, and as a range."""
    gate = 1 << (GATE - 1)
    below, above = gate >> 1, gate << 1
    for n in range(count):
        yield worker.command(gate, gate)
        yield chance.uniform(0.0, HOLD_S)
        mask = (below, above, below | above, below | above << 2)[n % 4]
        yield worker.command(mask, mask if n & 4 else 0)
        yield HOLD_S


def _whole_pulses(module: SimulatedModule) -> int:
    """Pulses that ended by themselves, after their hold time, and were not ordered meanwhile."""
    gate = [each for each in module.switchings if each.output == GATE]
    return sum(
        start.value and not end.frame and abs(end.at - start.at - HOLD_S) < 1e-6
        for start, end in pairwise(gate)
    )


@proof("A12")
def a_neighbours_pulse_keeps_its_time(run: Run) -> Figure:
    """Writing the outputs beside a running pulse neither ends it nor starts it anew."""
    count = run.scale.of(40, 1000)
    chance = random.Random(12)  # noqa: S311  # moments, not secrets
    changed = busy = done = 0
    for config in _lines():
        worker = BusWorker(config)
        module = worker.line.modules[1]
        module.set_mode(GATE, pulse=True, hold_s=HOLD_S)
        worker.follow(_around_a_pulse(worker, count, chance))
        module.settle()
        changed += module.ordered[GATE, True] - _whole_pulses(module)
        busy += sum(verdict.reason is Reason.BUSY for verdict in worker.verdicts())
        done += _count(worker.verdicts(), Status.DONE)
    total = count * len(WAYS)
    return Figure(
        injected=f"{total} pulses with a write of their neighbours meanwhile",
        seen=f"{changed} hold times changed; {done - total} writes done, {busy} busy",
        promised="0 changed; each write done or busy",
        kept=changed == 0 and busy > 0 and done + busy == 2 * total,
    )
