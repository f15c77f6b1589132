"""Slow: D1 dead stations, D2 reads and system calls of one exchange."""

import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass, replace
from itertools import pairwise
from types import FrameType
from typing import Any

from support.bus_worker import BusWorker, Script
from support.virtual_worker import make_line, make_station

from bridge.config.schema import LineConfig
from bridge.daemon.wiring import open_bus
from bridge.drivers import driver_for
from bridge.model import DIO100, LineProtocol, Status
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from proofs.figures import Figure, Run, proof

# --- D1 ---------------------------------------------------------------------------------------

SLOWER_BY_S = 0.5
COMMAND_WITHIN_MS = 2000
HEALTHY_S = 20.0
SETTLED_S = 20.0  # by then the dead ones were found dead, and the live one was met again


@dataclass(frozen=True, slots=True)
class _Pace:
    """How a line with dead stations compares with the same line in health."""

    normal_s: float
    longest_s: float
    slowest_ms: int
    done: int
    asked: int

    @property
    def kept(self) -> bool:
        """Whether dead stations cost the live one little."""
        in_time = self.longest_s <= self.normal_s + SLOWER_BY_S
        return in_time and self.slowest_ms <= COMMAND_WITHIN_MS and self.done == self.asked > 0

    def __str__(self) -> str:
        return f"{self.normal_s:.2f} -> {self.longest_s:.2f} s"


def _crowd(protocol: LineProtocol) -> LineConfig:
    # Station 0 is Modbus' broadcast address: over RTU a line has 31.
    first = 0 if protocol is LineProtocol.WISCO else 1
    stations = [make_station(address) for address in range(first, 32)]
    return make_line(*stations, protocol=protocol, baud=57600)


def _dying(worker: BusWorker, seconds: int) -> Script:
    """All live for a while; then all but station 1 die at once, and it is commanded."""
    yield HEALTHY_S
    for address, module in worker.line.modules.items():
        module.away = address != 1
    yield SETTLED_S
    for n in range(seconds):
        yield 0.9  # with what a command takes, it comes at any part of the round
        yield worker.command(0b1, n % 2)


def _pace(config: LineConfig, seconds: int) -> _Pace:
    worker = BusWorker(config)
    begun = worker.line.now
    worker.follow(_dying(worker, seconds))
    frame = driver_for(config.protocol, 1, DIO100).read_inputs.frame
    reads = [at for at, sent in worker.line.wire if sent == frame]
    gaps = [(since, until - since) for since, until in pairwise(reads)]
    died_at = begun + HEALTHY_S
    verdicts = worker.verdicts()
    return _Pace(
        normal_s=max(gap for at, gap in gaps if died_at - HEALTHY_S / 2 < at < died_at - 1),
        longest_s=max(gap for at, gap in gaps if at >= died_at + SETTLED_S),
        slowest_ms=max(verdict.ms for verdict in verdicts),
        done=sum(verdict.status is Status.DONE for verdict in verdicts),
        asked=seconds,
    )


@proof("D1")
def all_but_one_station_are_dead(run: Run) -> Figure:
    """The live one is read nearly as often as before, and obeys at once."""
    seconds = run.scale.of(20, 900)
    rtu, wisco = (_pace(_crowd(p), seconds) for p in (LineProtocol.MODBUS_RTU, LineProtocol.WISCO))
    slowest_s = max(rtu.slowest_ms, wisco.slowest_ms) / 1000
    return Figure(
        injected=f"30 of 31 dead (RTU), 31 of 32 (Wisco), {seconds} s",
        seen=f"cycle {rtu}, {wisco}; {rtu.done + wisco.done} done in {slowest_s:.2f} s",
        promised=f"cycle + {SLOWER_BY_S} s at most, all commands in 2 s",
        kept=rtu.kept and wisco.kept,
    )


# --- D2 ---------------------------------------------------------------------------------------

SYSTEM_CALLS = {"read", "write", "poll"}  # all that an open port is used with
READS_AT_MOST = 2  # as much as a refusal has, then the rest: nothing is read byte by byte
CALLS_AT_MOST = 7  # and one look at the input before, one wait for each read and write


@dataclass(frozen=True, slots=True)
class _Cost:
    """What one exchange takes of this computer."""

    reads: float
    calls: float
    cpu_ms: float
    round_trip_ms: float

    @property
    def kept(self) -> bool:
        """Whether the reply is read in no more than the pieces that its form has."""
        return 1 <= self.reads <= READS_AT_MOST and self.calls <= CALLS_AT_MOST


@contextmanager
def _counted_calls() -> Iterator[Counter[str]]:
    """Counts the system calls that this thread makes through a port."""
    counted: Counter[str] = Counter()

    def note(_frame: FrameType, event: str, called: Any) -> None:
        if event == "c_call" and called.__name__ in SYSTEM_CALLS:
            counted[called.__name__] += 1

    sys.setprofile(note)
    try:
        yield counted
    finally:
        sys.setprofile(None)


def _cost(protocol: LineProtocol, count: int) -> _Cost:
    modules = [SimulatedModule(DIO100, 1)]
    with SimulatedLine(protocol, 57600, modules, paced=False, turnaround_s=0.0) as line:
        config = make_line(make_station(1), protocol=protocol, baud=57600)
        bus = open_bus(replace(config, port=line.port))
        driver = driver_for(protocol, 1, DIO100)

        def exchange() -> None:
            bus.exchange(driver.read_inputs, protected=driver.protected)

        try:
            exchange()  # the first learns whether the adapter echoes
            with _counted_calls() as calls:
                for _ in range(count):
                    exchange()
            began, cpu_began = time.monotonic(), time.thread_time()
            for _ in range(count):
                exchange()
            took_s, cpu_s = time.monotonic() - began, time.thread_time() - cpu_began
        finally:
            bus.close()
    return _Cost(
        reads=calls["read"] / count,
        calls=calls.total() / count,
        round_trip_ms=1000 * took_s / count,
        cpu_ms=1000 * cpu_s / count,
    )


@proof("D2")
def one_exchange_on_a_pty(run: Run) -> Figure:
    """A reply is read as whole as it comes: few system calls, little processor time."""
    count = run.scale.of(50, 5000)
    costs = [_cost(protocol, count) for protocol in LineProtocol]
    reads, calls, cpu_ms, round_trip_ms = (
        max(figures) for figures in zip(*map(astuple, costs), strict=True)
    )
    return Figure(
        injected=f"{count} exchanges on a pty, each protocol; the worst:",
        seen=f"{reads:.1f} reads, {calls:.1f} calls, CPU {cpu_ms:.2f} of {round_trip_ms:.1f} ms",
        promised=f"at most {READS_AT_MOST} reads, {CALLS_AT_MOST} system calls",
        kept=all(cost.kept for cost in costs),
    )
