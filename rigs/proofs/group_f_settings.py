"""F4 and F8: modes that change, and outputs that a command does not name.

All runs in virtual time: the real line worker and the real bus, the modules of the simulator.
"""

import random
from dataclasses import dataclass, field
from functools import partial

from support.bus_worker import BusWorker, Script
from support.virtual_worker import make_line, make_station

from bridge.config.schema import OutputConfig
from bridge.model import DIO100, Command, LineProtocol, Status, Verdict, Word, Writes, bit
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.module import SimulatedModule, Switching
from proofs.figures import Figure, Run, proof

# --- F4 ---------------------------------------------------------------------------------------

_HOLDS_S = (0.1, 0.2, 0.5)
_REST_S = 1.0  # longer than any hold time: what is ON then stays ON
_COMMAND_S = 0.6  # a mode is changed within so much of the moment of a command


@dataclass
class _Witness:
    """The record of the outputs of a module, by an observer that knows its modes.

    Attributes:
        asked: The outputs of the present command.
        begun: How many pulses it began on each.
        second: Commands that began two on one output.
        disturbed: Running pulses of others that were ordered again.
        left_on: Outputs that got a PRESS and stayed ON.
    """

    worker: BusWorker
    module: SimulatedModule
    asked: int = 0
    begun: dict[int, int] = field(default_factory=dict)
    second: int = 0
    disturbed: int = 0
    left_on: int = 0
    _until: dict[int, float] = field(default_factory=dict)

    def saw(self, _station: int, what: Switching) -> None:
        """Take one order to an output, or the end of its pulse."""
        running = self._until.pop(what.output, 0.0) > what.at
        settings = self.module.settings
        pulse = what.value and bool(settings.pulse & bit(what.output))
        if pulse:
            self._until[what.output] = what.at + settings.hold_ds[what.output - 1] / 10
        if not what.frame:
            return
        if not self.asked & bit(what.output):
            self.disturbed += running
        elif pulse:
            self.begun[what.output] = self.begun.get(what.output, 0) + 1

    def begins(self, command: Command) -> Command:
        """A command is given."""
        self._count_second()
        self.asked = command.mask
        return command

    def ends(self, command: Command) -> None:
        """End the command and every pulse."""
        self._count_second()
        if command.word is Word.PRESS and self.module.outputs & command.mask:
            own = [s for s in self.module.switchings if s.at >= command.arrived]
            self.left_on += any(bit(s.output) == command.mask and s.value for s in own)

    def change_mode(self, output: int, hold_s: float, *, pulse: bool) -> None:
        """The tool does it, but to a running pulse: what becomes of that is not stated."""
        if self._until.get(output, 0.0) <= self.worker.line.now:
            self.module.set_mode(output, pulse=pulse, hold_s=hold_s)

    def _count_second(self) -> None:
        self.second += any(count > 1 for count in self.begun.values())
        self.begun.clear()


def _random_command(worker: BusWorker, chance: random.Random) -> Command:
    first = chance.randrange(DIO100.outputs)
    match chance.randrange(4):
        case 0:
            return worker.command(1 << first, 1 << first, word=Word.PRESS)
        case 1:
            return worker.command(1 << first, chance.choice((0, 1 << first)))
        case 2:
            return worker.command(1 << first, word=Word.TOGGLE)
    return _around(worker, 1 << first, chance)


def _around(worker: BusWorker, gap: int, chance: random.Random) -> Command:
    """A command to the outputs on both sides of one, or to two others where it has none."""
    mask = gap << 1 & 0xFF | gap >> 1 or gap
    return worker.command(mask, mask & chance.randrange(1 << DIO100.outputs))


def _is_lost(chance: random.Random, frame: bytes) -> bool:
    return chance.random() < (0.2 if is_write(frame) else 0.03)


def _while_modes_change(
    worker: BusWorker, witness: _Witness, count: int, chance: random.Random
) -> Script:
    for _ in range(count):
        output, hold_s = chance.randrange(1, DIO100.outputs + 1), chance.choice(_HOLDS_S)
        change = partial(witness.change_mode, output, hold_s, pulse=chance.random() < 0.5)
        now = worker.line.now
        worker.line.at(now + chance.uniform(0.0, _COMMAND_S), change)
        yield chance.uniform(0.0, _COMMAND_S)
        command = witness.begins(_random_command(worker, chance))
        yield command
        if command.values and command.word is None and chance.random() < 0.5:
            gap = command.values & -command.values  # it may be a pulse that runs by now
            yield witness.begins(_around(worker, gap, chance))
        yield _REST_S
        witness.ends(command)


@proof("F4")
def modes_are_changed_behind_our_back(run: Run) -> Figure:
    """A tool at the module changes modes at any moment, and replies are lost."""
    count = run.scale.of(30, 1000)
    left_on = second = disturbed = done = 0
    ways = [LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII, LineProtocol.WISCO]
    for protocol in ways:
        chance = random.Random(4)  # noqa: S311  # moments, not secrets
        worker = BusWorker(make_line(make_station(1), protocol=protocol))
        witness = _Witness(worker, worker.line.modules[1])
        worker.line.modules[1]._listener = witness.saw
        worker.bus_line.faults.set(FaultKind.SILENT, only=partial(_is_lost, chance))
        worker.follow(_while_modes_change(worker, witness, count, chance))
        left_on += witness.left_on
        second += witness.second
        disturbed += witness.disturbed
        done += sum(verdict.status is Status.DONE for verdict in worker.verdicts())
    total = count * len(ways)
    return Figure(
        injected=f"{total} modes changed by a tool while {total} commands lose replies",
        seen=f"{left_on} relays left ON, {second} second pulses, {disturbed} hold times changed, "
        f"{done} done",
        promised="0, 0, 0; half of them done",
        kept=(left_on, second, disturbed) == (0, 0, 0) and done > total // 2,
    )


# --- F8 ---------------------------------------------------------------------------------------

_FOREIGN = 3  # what another master switches; 2 and 4 are ours
_BESIDE = bit(2) | bit(4)


class _OtherMaster:
    """Another master, which switches the output at any moment."""

    def __init__(self, module: SimulatedModule) -> None:
        self.module = module
        self.value = False
        self.undone = 0

    def switch(self) -> None:
        """Turn the output over; whether it was as it was left is counted."""
        self.look()
        self.value = not self.value
        self.module.set_output(_FOREIGN, self.value)

    def look(self) -> None:
        """Count what was undone."""
        self.undone += bool(self.module.outputs & bit(_FOREIGN)) is not self.value


def _beside_another(
    worker: BusWorker, other: _OtherMaster, count: int, chance: random.Random
) -> Script:
    for n in range(count):
        worker.line.at(worker.line.now + chance.uniform(0.0, 0.15), other.switch)
        verdict: Verdict | None = yield worker.command(_BESIDE, _BESIDE if n % 2 else 0)
        assert verdict is not None
        yield 0.2
        other.look()


@proof("F8")
def an_output_of_another_lies_between_ours(run: Run) -> Figure:
    """A `read_only` output in the gap of a write of several is never written over."""
    count = run.scale.of(40, 1000)
    undone = done = 0
    ways = [(protocol, Writes.AUTO) for protocol in LineProtocol]
    ways += [(LineProtocol.WISCO, Writes.WISCO)]
    for protocol, writes in ways:
        chance = random.Random(8)  # noqa: S311  # moments, not secrets
        outputs = tuple(OutputConfig(n, read_only=n == _FOREIGN) for n in range(1, 9))
        line = make_line(make_station(1, outputs=outputs), protocol=protocol, writes=writes)
        worker = BusWorker(line)
        other = _OtherMaster(worker.line.modules[1])
        worker.follow(_beside_another(worker, other, count, chance))
        undone += other.undone
        done += sum(verdict.status is Status.DONE for verdict in worker.verdicts())
    total = count * len(ways)
    return Figure(
        injected=f"{total} switchings by another master between two outputs that are written",
        seen=f"{undone} undone, {done} writes done",
        promised=f"0 undone, {total} writes done",
        kept=undone == 0 and done == total,
    )
