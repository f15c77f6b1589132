"""A scenario file: what happens to simulated lines, and when.

```yaml
loop: true                # begin again at the last `at`
steps:
  - {at: 500ms, station: 1, input: 3, set: ON}
  - {every: 2s, station: 1, input: 4, set: TOGGLE}
  - {at: 5s, fault: late, delay: 300ms, station: 2, probability: 0.5}   # or times: 3
  - {at: 8s, fault: late, station: 2, set: OFF}
  - {at: 9s, station: 2, module: away}
  - {at: 10s, station: 2, module: back}
```

Without a station a fault is for the whole line. With several lines a step says `line: main`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bridge.config.compose import compose
from bridge.config.durations import duration
from bridge.config.nodes import Place, Reader, Source, WrongValueError, items
from bridge.config.scalars import boolean, choice, positive_number, whole
from bridge.config.tables import Table, table_of
from bridge.errors import ConfigError, Problem
from bridge.files import read_file
from bridge.model import LAST_ADDRESS
from bridge.simulator.actions import Action, DriveInput, InputWord, MoveModule, PutFault, TakeFault
from bridge.simulator.faults import FaultKind
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

MOST_TIMES = 1_000_000
SUBJECTS = ("input", "module", "fault")  # each step has exactly one of these

_instant = duration("0s", "1440min")
_interval = duration("10ms", "1440min")
_delay = duration("0s", "60s")


@dataclass(frozen=True, slots=True)
class ScenarioStep:
    """One action and its time, in seconds since the start; `every` repeats it."""

    after_s: float
    every: bool
    action: Action


@dataclass(frozen=True, slots=True)
class Scenario:
    """All steps, in the order of the file.

    `period_s`: the `at` steps repeat after this; None: they do not.
    """

    steps: tuple[ScenarioStep, ...]
    period_s: float | None


def load_scenario(path: Path, lines: Mapping[str, SimulatedLine]) -> Scenario:
    """Load a scenario for these lines.

    Raises:
        ConfigError: Every problem of the file, each with its place.
    """
    try:
        text = read_file(path).decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        problem = Problem(str(path), 1, 1, f"the scenario cannot be read: {reason}")
        raise ConfigError([problem]) from error
    source = Source(path, {}, [])
    scenario = Place(source, compose(text, str(path)), "").read(_scenario(lines), None)
    if source.problems or scenario is None:
        raise ConfigError(source.problems)
    return scenario


def _scenario(lines: Mapping[str, SimulatedLine]) -> Reader[Scenario]:
    def read(place: Place) -> Scenario:
        with table_of(place) as table:
            loop = table.get("loop", boolean, False)
            advice = "list what happens, such as {at: 1s, station: 1, input: 3, set: ON}"
            steps = table.need("steps", _steps(lines), advice) or ()
            last_s = max((step.after_s for step in steps if not step.every), default=0.0)
            # A step that cannot be read already has its problem: `at` is not reported as missing
            # too.
            if loop and not last_s and not place.source.problems:
                table.problem("loop", "there is nothing to repeat: no step has an at above 0s")
        return Scenario(steps, last_s if loop else None)

    return read


def _steps(lines: Mapping[str, SimulatedLine]) -> Reader[tuple[ScenarioStep, ...]]:
    def read(place: Place) -> tuple[ScenarioStep, ...]:
        steps = [item.read(_step(lines), None) for item in items(place)]
        return tuple(step for step in steps if step)

    return read


def _step(lines: Mapping[str, SimulatedLine]) -> Reader[ScenarioStep | None]:
    def read(place: Place) -> ScenarioStep | None:
        with table_of(place) as table:
            at = table.get("at", _instant, None)
            every = table.get("every", _interval, None)
            if ("at" in table) == ("every" in table):
                place.problem("a step has one of at and every")
            action = _action(place, table, _line(place, table, lines))
        after_s = at if every is None else every
        return (
            ScenarioStep(after_s, every is not None, action)
            if action and after_s is not None
            else None
        )

    return read


def _line(place: Place, table: Table, lines: Mapping[str, SimulatedLine]) -> SimulatedLine | None:
    only = next(iter(lines.values())) if len(lines) == 1 else None
    if only is None and "line" not in table:
        place.problem(f"there are several lines: say line: {' or '.join(lines)}")
    return table.get("line", choice(lines), only)


def _action(place: Place, table: Table, line: SimulatedLine | None) -> Action | None:
    subjects = [subject for subject in SUBJECTS if subject in table]
    if len(subjects) != 1:
        place.problem(f"a step has one of {', '.join(SUBJECTS)}")
    if line is None or len(subjects) != 1:
        _take_all(table)
        return None
    if subjects == ["fault"]:
        return _fault(table, line)
    module = table.need("station", _module(line), "say whose it is")
    if module is None:
        _take_all(table)
        return None
    return _input(table, module) if subjects == ["input"] else _move(table, module)


def _take_all(table: Table) -> None:
    """Read all keys of a step that has a problem: they are not reported as unknown."""
    for key in ("station", "set", "probability", "times", "delay", *SUBJECTS):
        table.get(key, lambda _: None, None)


def _input(table: Table, module: SimulatedModule) -> Action | None:
    channel = table.get("input", _channel(module), None)
    words = {word.value: word for word in InputWord}
    word = table.need("set", choice(words), "write ON, OFF or TOGGLE")
    return DriveInput(module, channel, word) if channel and word else None


def _move(table: Table, module: SimulatedModule) -> Action | None:
    away = table.get("module", choice({"away": True, "back": False}), None)
    return None if away is None else MoveModule(module, away)


def _fault(table: Table, line: SimulatedLine) -> Action | None:
    kind = table.get("fault", choice({kind.value: kind for kind in FaultKind}), None)
    module = table.get("station", _module(line), None)
    address = module.address if module else None
    if kind is FaultKind.ECHO and module:
        table.problem("station", "echo is the adapter's: it is for the whole line")
    on = table.get("set", choice({"ON": True, "OFF": False}), True)
    probability = table.get("probability", positive_number(1), 1.0)
    times = table.get("times", whole(1, MOST_TIMES), None)
    delay_s = table.get("delay", _delay, None)
    if kind is None:
        return None
    if on:
        return PutFault(line, kind, address, probability, times, delay_s)
    return TakeFault(line, kind, address)


def _module(line: SimulatedLine) -> Reader[SimulatedModule]:
    def read(place: Place) -> SimulatedModule:
        address = whole(0, LAST_ADDRESS)(place)
        if address not in line.modules:
            there = ", ".join(map(str, line.modules))
            raise WrongValueError(
                f"no module is at station {address} of line {line.name}; there is {there}"
            )
        return line.modules[address]

    return read


def _channel(module: SimulatedModule) -> Reader[int]:
    def read(place: Place) -> int:
        if not module.model.inputs:
            raise WrongValueError(f"a {module.model.name} has no inputs; name another station")
        return whole(1, module.model.inputs)(place)

    return read
