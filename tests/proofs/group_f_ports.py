"""Gateways that two programs use, that replay, that close, and that fall deaf: F12, F13, F19, F20.

All of it runs in virtual time.
"""

import random
from dataclasses import replace

from support.judged_worker import JudgedWorker
from support.shared_wire import SharedWire
from support.virtual_worker import make_line, make_station

from bridge.drivers import driver_for
from bridge.model import DIO100, LineProtocol, Writes
from proofs.figures import Figure, Run, proof

# --- F12 --------------------------------------------------------------------------------------

COMES_S = 20.0  # the other master


def _two_masters(writes: Writes, count: int, seconds: float, seed: int) -> tuple[int, int, int]:
    """Two masters poll the same modules; returns false states, reads of both."""
    chance = random.Random(seed)  # noqa: S311  # moments, not secrets
    stations = [make_station(n) for n in range(1, count + 1)]
    config = make_line(*stations, protocol=LineProtocol.WISCO, writes=writes)
    wisco_only = writes is Writes.WISCO
    config = replace(config, port="tcp://gateway:4196")
    worker = JudgedWorker(config, chance, wisco_only=wisco_only)
    readers = [driver_for(LineProtocol.WISCO, n, DIO100) for n in range(1, count + 1)]
    frames = [f for r in readers for f in (r.read_inputs.frame, r.read_outputs.frame)]
    wire = SharedWire(worker.bus_line.conversation, frames, chance, worker.line.now + COMES_S)
    worker.bus_line.conversation = wire  # type: ignore[assignment]  # as far as a port uses it
    worker.change()
    worker.run(worker.line.now + COMES_S + seconds)
    return worker.false, worker.reads, wire.served


@proof("F12")
def two_masters_on_one_gateway(run: Run) -> Figure:
    """Replies to the other master become no states, over frames that do not say whose they are."""
    seconds = run.scale.of(60, 3600)
    false = reads = foreign = 0
    for seed, (writes, count) in enumerate(
        (w, n) for w in (Writes.AUTO, Writes.WISCO) for n in (1, 2, 4)
    ):
        each = _two_masters(writes, count, seconds, seed)
        print(writes, count, each)
        false, reads, foreign = false + each[0], reads + each[1], foreign + each[2]
    return Figure(
        injected=f"another master on the gateway, {seconds} s in 6 ways, {foreign} exchanges",
        seen=f"{false} false states in {reads} reads of ours",
        promised="0 false states",
        kept=false == 0 and foreign > seconds,
    )
