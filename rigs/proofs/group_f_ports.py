"""Gateways that two programs use, that replay, that close, and that fall deaf: F12, F13, F19, F20.

All of it runs in virtual time. The locks are shown on real processes in tests/end_to_end.
"""

import logging
import math
import random
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product

from support.gateway_line import GatewayWorker
from support.virtual_worker import make_line, make_station

from bridge.drivers import driver_for
from bridge.model import DIO100, LineProtocol, Writes
from bridge.simulator.faults import FaultKind
from proofs.figures import Figure, Run, proof
from proofs.judged_worker import JudgedWorker
from proofs.replaying_wire import ReplayingWire
from proofs.shared_wire import SharedWire

GATEWAY = "tcp://gateway:4196"

# --- F12 --------------------------------------------------------------------------------------

# Modules that take Modbus frames or none but Wisco's, how many, and when the other master comes.
MEETINGS = tuple(product((Writes.AUTO, Writes.WISCO), (1, 2, 4, 8), (0.0, 20.0)))


def _two_masters(
    writes: Writes, count: int, comes_s: float, seconds: float, chance: random.Random
) -> tuple[JudgedWorker, int]:
    """Two masters poll the same modules; returns ours, and how often the other one asked."""
    stations = [make_station(n) for n in range(1, count + 1)]
    config = make_line(*stations, protocol=LineProtocol.WISCO, writes=writes)
    worker = JudgedWorker(replace(config, port=GATEWAY), chance, wisco_only=writes is Writes.WISCO)
    readers = [driver_for(LineProtocol.WISCO, n, DIO100) for n in range(1, count + 1)]
    frames = [f for r in readers for f in (r.read_inputs.frame, r.read_outputs.frame)]
    wire = SharedWire(worker.bus_line.conversation, frames, chance, worker.line.now + comes_s)
    worker.bus_line.conversation = wire  # type: ignore[assignment]  # as far as a port uses it
    worker.change()
    worker.run(worker.line.now + comes_s + seconds)
    return worker, wire.served


@proof("F12")
def two_masters_on_one_gateway(run: Run) -> Figure:
    """Replies to the other master become no states, over frames that do not say whose they are."""
    seconds = run.scale.of(20, 1800)
    chance = random.Random(12)  # noqa: S311  # moments, not secrets
    false = told = foreign = 0
    for writes, count, comes_s in MEETINGS:
        worker, served = _two_masters(writes, count, comes_s, seconds, chance)
        false, told, foreign = false + worker.false, told + worker.told, foreign + served
    return Figure(
        injected=f"{foreign} exchanges of another master on the gateway, {len(MEETINGS)} lines",
        seen=f"{false} false states, {told} told",
        promised="0 false states",
        kept=false == 0 and told > seconds,
    )


# --- F13 --------------------------------------------------------------------------------------

DROPS_EVERY_S = 6.0


def _replays(protocol: LineProtocol, drops: int, chance: random.Random) -> tuple[int, int, int]:
    """Connections begin with old replies; returns how many did, false states and true ones."""
    stations = [make_station(1), make_station(2)]
    config = replace(make_line(*stations, protocol=protocol), port=GATEWAY)
    worker = JudgedWorker(config, chance)
    wire = ReplayingWire(worker.bus_line.conversation, chance, worker.line.clock)
    worker.bus_line.conversation = wire  # type: ignore[assignment]  # as far as a port uses it
    for n in range(1, drops + 1):
        worker.line.at(
            worker.line.now + n * DROPS_EVERY_S + chance.random(),
            lambda: worker.bus_line.faults.set(FaultKind.HANG_UP, times=1),
        )
    worker.change()
    worker.run(worker.line.now + (drops + 2) * DROPS_EVERY_S)
    return wire.replays, worker.false, worker.told


@proof("F13")
def a_gateway_replays(run: Run) -> Figure:
    """Bytes that a gateway held back for the next connection are not taken as a reply."""
    drops = run.scale.of(10, 350)
    chance = random.Random(13)  # noqa: S311  # moments, not secrets
    seen = [_replays(protocol, drops, chance) for protocol in LineProtocol]
    replays, false, told = (sum(each[n] for each in seen) for n in range(3))
    return Figure(
        injected=f"{replays} reconnects that begin with old replies",
        seen=f"{false} false states, {told} told",
        promised="0 false states",
        kept=false == 0 and replays >= 0.9 * drops * len(seen) and told > drops,
    )


# --- F19 --------------------------------------------------------------------------------------

DAY_S = 24 * 3600.0


class _Lines(logging.Handler):
    """Counts what is logged."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:  # noqa: ARG002 - it is only counted
        """Takes one record."""
        self.count += 1


@contextmanager
def _log_lines() -> Iterator[_Lines]:
    logger, handler = logging.getLogger("bridge"), _Lines()
    level = logger.level
    logger.setLevel(logging.INFO)
    logger.addHandler(handler)
    try:
        yield handler
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


@proof("F19")
def an_idle_connection_is_closed(run: Run) -> Figure:
    """With the panel off, a gateway that closes its connection every 10 s causes few log lines."""
    seconds = run.scale.of(3600, int(DAY_S))
    worker = GatewayWorker(make_line(make_station(1), protocol=LineProtocol.MODBUS_RTU))
    worker.gateway.idle_s = 10.0
    off_at = worker.line.now + 60.0
    worker.line.at(off_at, lambda: setattr(worker.line.modules[1], "away", True))
    with _log_lines() as lines:
        worker.run(off_at + seconds)
    closes, told = len(worker.line.opened) - 1, len(worker.told_of_line())
    return Figure(
        injected=f"panel off for {seconds / 3600:.0f} h, {closes} idle connections closed",
        seen=f"{lines.count} log lines, the line was told {told} times",
        promised="4 log lines, the line told once",
        kept=lines.count <= 4 and told == 1 and closes > seconds / 60,
    )


# --- F20 --------------------------------------------------------------------------------------

BACK_WITHIN_S = 15.0


def _deaf(stations: int, protocol: LineProtocol, times: int, chance: random.Random) -> list[float]:
    """The connection goes deaf again and again; returns how long until all were back."""
    worker = GatewayWorker(make_line(*map(make_station, range(1, stations + 1)), protocol=protocol))
    deaf_at = [worker.line.now + 60.0 + n * 60.0 + chance.random() * 20 for n in range(times)]
    for instant in deaf_at:
        worker.line.at(instant, lambda at=instant: setattr(worker.gateway, "deaf_before", at))  # type: ignore[misc]  # a lambda with a default
    worker.run(worker.line.now + 100.0 + times * 60.0)
    told = [worker.online_at(f"s{n}") for n in range(1, stations + 1)]
    return [
        max(next((at for at, up in each if up and at > when), math.inf) - when for each in told)
        for when in deaf_at
    ]


@proof("F20")
def a_connection_goes_deaf(run: Run) -> Figure:
    """Nothing comes any more and nothing is closed: another connection is made."""
    times, modules = run.scale.of(1, 20), (1, 8, 31)[: run.scale.of(2, 3)]
    chance = random.Random(20)  # noqa: S311  # moments, not secrets
    back_s = [
        took
        for protocol, stations in product(LineProtocol, modules)
        for took in _deaf(stations, protocol, times, chance)
    ]
    return Figure(
        injected=f"{len(back_s)} connections that went deaf, of 1 to {modules[-1]} modules",
        seen=f"all modules back within {max(back_s):.1f} s",
        promised=f"back within {BACK_WITHIN_S:.0f} s",
        kept=max(back_s) <= BACK_WITHIN_S,
    )
