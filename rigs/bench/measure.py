"""Runs one case: the bare loop, the bridge with a plain cycle, the bridge with its own plan."""

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from bench.cases import Case
from bench.daemon import MeasuredDaemon
from bench.figures import Spread, cycles, delays_of_inputs
from bench.frames import reads_of
from bench.listener import Listener
from bench.wire import Wire
from bridge.line.plan.rotation import SOON

_START_S = 60.0
_SETTLE_S = 2.0  # after the start, until the figures of a running bridge are taken
_COMMAND_S = 5.0
_SWEEPS = 5


@dataclass(slots=True)
class Result:
    """Everything that was measured of one case; times in milliseconds."""

    case: str
    load_before: float
    limit_cycle: float
    limit_start: float
    bare_cycle: Spread | None = None
    plain_cycles: list[Spread | None] = field(default_factory=list)  # one for each line
    plain_cpu: float = 0.0
    start: float = 0.0
    inputs: Spread | None = None
    inputs_expected: float = 0.0
    command_to_wire: Spread | None = None
    command_to_verdict: Spread | None = None
    failed_commands: int = 0
    foreign: Spread | None = None
    messages_a_second: float = 0.0
    cpu: float = 0.0
    rss_mb: float = 0.0
    early: int = 0
    overlapping: int = 0
    bare_early: int = 0
    load_after: float = 0.0


def measure(case: Case, broker: int) -> Result:
    """Runs it on lines of its own."""
    result = Result(
        case=case.name,
        load_before=os.getloadavg()[0],
        limit_cycle=case.limit.cycle_s(len(case.live)) * 1000,
        limit_start=case.limit.start_s(len(case.live)) * 1000,
        inputs_expected=_expected_inputs_s(case) * 1000,
    )
    with (
        Wire([case.spec] * case.lines) as wire,
        Listener(broker) as listener,
        tempfile.TemporaryDirectory(prefix="bench-") as directory,
    ):
        if case.lines == 1 and not case.dead:
            _bare(case, wire, result)
        bench = _Bench(case, wire, listener, broker, Path(directory), result)
        bench.plain()
        bench.own_plan()
    result.load_after = os.getloadavg()[0]
    return result


def _expected_inputs_s(case: Case, sweep_s: float = 2.0) -> float:
    """Half a round of inputs and the reading itself; a change over Wisco frames is read twice.

    Of the round the sweep of the outputs takes its share, and so do the stations that changed:
    they are read once more, soon, though not oftener than one read in `SOON`.
    """
    limit, count = case.limit, len(case.live)
    swept = min(count * limit.outputs_s / sweep_s, 0.5)
    again = 0.0
    if count > SOON:
        changes = limit.inputs_s / case.toggle_each_s / case.lines
        again = min(changes, (1 - swept) / (SOON + 1))
    round_s = count * limit.inputs_s / (1 - swept - again)
    return round_s / 2 + limit.inputs_s * (2 if case.protocol == "wisco" else 1)


def _bare(case: Case, wire: Wire, result: Result) -> None:
    requests = [
        f"{frame.hex()}:{size}"
        for address in case.addresses
        for frame, size in reads_of(case.protocol, address)
    ]
    arguments = [wire.ports[0], str(case.baud), str(case.physics.silence_s), str(case.plain_s)]
    wire.begin()
    subprocess.run([sys.executable, "-m", "bench.bare", *arguments, *requests], check=True)
    seen = wire.take()
    result.bare_cycle = cycles(seen.reads, 0)
    result.bare_early = seen.early + seen.overlapping


class _Bench:
    """One case's bridge, twice."""

    def __init__(
        self,
        case: Case,
        wire: Wire,
        listener: Listener,
        broker: int,
        directory: Path,
        result: Result,
    ) -> None:
        self._case = case
        self._wire = wire
        self._listener = listener
        self._broker = broker
        self._directory = directory
        self._result = result
        self._chance = random.SystemRandom()

    def plain(self) -> None:
        """Inputs and outputs of every station in turn: that is compared with the bare loop."""
        with self._daemon(plain=True) as daemon:
            self._wait_until_complete(daemon)
            time.sleep(_SETTLE_S)
            self._wire.begin()
            daemon.begin()
            time.sleep(self._case.plain_s)
            seen = self._wire.take()
            self._result.plain_cpu = daemon.cpu_percent()
            self._count_faults(seen.early, seen.overlapping)
            self._result.plain_cycles = [
                cycles(seen.reads, line) for line in range(self._case.lines)
            ]

    def own_plan(self) -> None:
        """The plan as it is by default, with inputs that change and commands that come."""
        with self._daemon(plain=False) as daemon:
            self._result.start = round((self._wait_until_complete(daemon)) * 1000)
            time.sleep(_SETTLE_S + 3 * self._case.dead)  # until the dead are probed rarely
            daemon.begin()
            self._inputs()
            self._result.cpu = daemon.cpu_percent()
            self._commands()
            self._foreign()
            self._result.rss_mb = daemon.rss_mb()

    def _daemon(self, *, plain: bool) -> MeasuredDaemon:
        path = self._directory / f"{'plain' if plain else 'own'}.yaml"
        case = self._case
        path.write_text(
            case.config(self._wire.ports, self._broker, str(self._directory), plain=plain)
        )
        self._listener.begin()
        return MeasuredDaemon(path)

    def _wait_until_complete(self, daemon: MeasuredDaemon) -> float:
        """Until every state, mode and hold time of those that answer is there."""
        wanted = {
            f"bench/l{line}-s{address}/{part}"
            for line in range(self._case.lines)
            for address in self._case.live
            for part in (
                *(f"di/{channel}" for channel in range(1, 17)),
                *(f"do/{channel}" for channel in range(1, 9)),
                *(f"do/{channel}/hold" for channel in range(1, 9)),
            )
            if address != 0 or not part.endswith("hold")  # Modbus does not reach station 0
        }
        return self._listener.wait_until(wanted.issubset, _START_S) - daemon.started_at

    def _inputs(self) -> None:
        case = self._case
        self._wire.begin()
        self._listener.begin()
        self._wire.toggle(case.toggle_each_s)
        time.sleep(case.toggle_s)
        self._wire.toggle(0)
        time.sleep(_SETTLE_S)
        seen, heard = self._wire.take(), self._listener.heard()
        self._count_faults(seen.early, seen.overlapping)
        self._result.inputs = delays_of_inputs(seen, heard)
        self._result.messages_a_second = round(len(heard) / (case.toggle_s + _SETTLE_S), 1)

    def _commands(self) -> None:
        """One after the other, at any phase of the round."""
        to_wire, to_verdict = [], []
        on: dict[tuple[int, int, int], bool] = {}
        self._wire.begin()
        for number in range(self._case.commands):
            key = line, address, output = (
                self._chance.randrange(self._case.lines),
                self._chance.choice(self._case.live),
                self._chance.randint(1, 8),
            )
            on[key] = not on.get(key, False)
            sent_at, verdict_at = self._command(number, f"l{line}-s{address}", output, on[key])
            writes = [
                at
                for at, of_line, of_station, _ in self._wire.take().writes
                if (of_line, of_station) == (line, address) and at > sent_at
            ]
            if writes:
                to_wire.append(writes[0] - sent_at)
                to_verdict.append(verdict_at - sent_at)
            time.sleep(self._chance.uniform(0.05, 0.15))
        self._result.command_to_wire = Spread.of(to_wire)
        self._result.command_to_verdict = Spread.of(to_verdict)
        seen = self._wire.take()
        self._count_faults(seen.early, seen.overlapping)

    def _command(self, number: int, station_id: str, output: int, on: bool) -> tuple[float, float]:
        """Returns when it was sent, and when its verdict came."""
        self._listener.begin()
        word = json.dumps({"state": "ON" if on else "OFF", "id": f"c{number}"})
        sent_at = self._listener.publish(f"bench/{station_id}/do/{output}/set", word)
        result = f"bench/{station_id}/result"
        self._listener.wait_until(lambda topics: result in topics, _COMMAND_S)
        (at, _, payload), *_ = [m for m in self._listener.heard() if m[1] == result]
        self._result.failed_commands += json.loads(payload)["status"] != "done"
        return sent_at, at

    def _foreign(self) -> None:
        """Another master switches an output: how long until that is on its topic."""
        delays = []
        for _ in range(_SWEEPS):
            line, address = (
                self._chance.randrange(self._case.lines),
                self._chance.choice(self._case.live),
            )
            for on in (True, False):
                self._listener.begin()
                at = self._wire.switch(line, address, 8, on)
                topic = f"bench/l{line}-s{address}/do/8"
                word = b"ON" if on else b"OFF"
                deadline = at + 10
                while time.monotonic() < deadline:
                    found = [
                        t for t, name, p in self._listener.heard() if (name, p) == (topic, word)
                    ]
                    if found:
                        delays.append(found[0] - at)
                        break
                    time.sleep(0.005)
                time.sleep(self._chance.uniform(0.0, 0.5))
        self._result.foreign = Spread.of(delays)

    def _count_faults(self, early: int, overlapping: int) -> None:
        self._result.early += early
        self._result.overlapping += overlapping
