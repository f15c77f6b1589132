"""The bridge's line worker with modules that read the manual otherwise, on a virtual clock."""

import random
from collections.abc import Iterator
from dataclasses import dataclass, field

from support.bus_worker import BusWorker
from support.virtual_worker import make_line, make_station

from bridge.model import (
    DIO100,
    DO100,
    AnyCommand,
    LineProtocol,
    ProblemChanged,
    Status,
    ValuesChanged,
    Verdict,
)
from bridge.simulator.dialect import Dialect
from bridge.simulator.module import SimulatedModule

STEP_S = 0.15
# How old the value may be that is published: two reads, and what else the line does meanwhile.
MOST_AGE_S = 3.0


@dataclass(slots=True)
class Told:
    """What came of one dialect."""

    dialect: Dialect
    protocol: LineProtocol
    done: int = 0
    asked: int = 0
    false_states: int = 0
    wrong_switchings: int = 0
    named: bool = False
    problems: set[str] = field(default_factory=set)

    @property
    def works(self) -> bool:
        """Whether nearly all was done."""
        return self.done >= 0.99 * self.asked


class _Truth:
    """What the inputs and outputs of a module were, and when."""

    def __init__(self, module: SimulatedModule, now: float) -> None:
        self._module = module
        self.inputs = [(now, module.inputs)]

    def drive(self, bits: int, now: float) -> None:
        """Sets all inputs."""
        for channel in range(1, self._module.model.inputs + 1):
            self._module.set_input(channel, bool(bits >> (channel - 1) & 1))
        self.inputs.append((now, bits))

    def was(self, inputs: int, outputs: int, now: float) -> bool:
        """Whether both were so, not long ago."""
        return inputs in _since(self.inputs, now) and outputs in _since(self._outputs(), now)

    def _outputs(self) -> list[tuple[float, int]]:
        value, history = self._first(), []
        history.append((0.0, value))
        for one in self._module.switchings:
            mask = 1 << (one.output - 1)
            value = value | mask if one.value else value & ~mask
            history.append((one.at, value))
        return history

    def _first(self) -> int:
        # Back from what they are, as the first switchings may be gone.
        value = self._module.outputs
        for one in reversed(self._module.switchings):
            if one.changed:
                value ^= 1 << (one.output - 1)
        return value


def _since(history: list[tuple[float, int]], now: float) -> set[int]:
    """The values that held at any time in the last moments."""
    begin = max((i for i, (at, _) in enumerate(history) if at <= now - MOST_AGE_S), default=0)
    return {value for at, value in history[begin:] if at <= now}


def lived_with(dialect: Dialect, protocol: LineProtocol, commands: int) -> Told:
    """Changes an input and sends a command, so often, and compares all with the modules."""
    chance = random.Random(f"{dialect} {protocol}")  # noqa: S311  # states, not secrets
    config = make_line(
        make_station(1, DIO100), make_station(2, DO100), protocol=protocol, baud=19200
    )
    worker = BusWorker(config, dialects=(dialect,))
    line, told = worker.bus_line, Told(dialect, protocol)
    truth = {f"s{at}": _Truth(module, line.now) for at, module in line.modules.items()}
    seen = 0

    def judge() -> None:
        nonlocal seen
        for at, event in worker.events[seen:]:
            if isinstance(event, ValuesChanged):
                told.false_states += not truth[event.station_id].was(
                    event.inputs, event.outputs, at
                )
            if isinstance(event, ProblemChanged) and event.detail:
                told.problems.add(event.detail)
                told.named |= "reading " in event.detail
        seen = len(worker.events)

    def script() -> Iterator[AnyCommand | float]:
        for number in range(commands):
            address = 1 + number % 2
            module = line.modules[address]
            truth["s1"].drive(chance.getrandbits(16), line.now)
            mask = 1 << chance.randrange(module.model.outputs)
            values = mask * chance.randrange(2)
            before = sum(other.ordered.total() for other in line.modules.values())
            own = module.ordered[mask.bit_length(), bool(values)]
            verdict = yield worker.command(mask, values, station_id=f"s{address}")
            assert isinstance(verdict, Verdict)
            ordered = sum(other.ordered.total() for other in line.modules.values()) - before
            own = module.ordered[mask.bit_length(), bool(values)] - own
            told.asked += 1
            done = verdict.status is Status.DONE
            told.done += done
            told.wrong_switchings += ordered != own or own > 2
            told.wrong_switchings += done and (module.outputs & mask) != values
            yield STEP_S
            judge()

    worker.follow(script())  # type: ignore[arg-type]
    judge()
    return told
