"""Scenario files: what they mean, and what is said about mistakes."""

import re
from pathlib import Path

import pytest

from bridge.errors import ConfigError
from bridge.model import DIO100, DO100
from bridge.simulator import FaultKind, SimulatedLine, SimulatedModule, scenario
from bridge.simulator.actions import DriveInput, InputWord, MoveModule, PutFault, TakeFault
from bridge.simulator.scenario import ScenarioStep, load_scenario


@pytest.fixture
def line() -> SimulatedLine:
    """A line that does not run, with a DIO100 at 1 and a DO100 at 2."""
    return SimulatedLine(
        "wisco", 9600, [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)], name="main"
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of the scenario."""
    return tmp_path / "scenario.yaml"


def test_every_kind_of_step(path: Path, line: SimulatedLine) -> None:
    """The example of the documentation is read as it says."""
    example = re.search(r"```yaml\n(.*)```", scenario.__doc__ or "", re.DOTALL)
    assert example
    path.write_text(example[1])
    read = load_scenario(path, {"main": line})
    one, two = line.module(1), line.module(2)
    assert read.period_s == 10.0
    assert read.steps == (
        ScenarioStep(0.5, False, DriveInput(one, 3, InputWord.ON)),
        ScenarioStep(2.0, True, DriveInput(one, 4, InputWord.TOGGLE)),
        ScenarioStep(5.0, False, PutFault(line, FaultKind.LATE, 2, 0.5, None, 0.3)),
        ScenarioStep(8.0, False, TakeFault(line, FaultKind.LATE, 2)),
        ScenarioStep(9.0, False, MoveModule(two, True)),
        ScenarioStep(10.0, False, MoveModule(two, False)),
    )


def test_scenario_that_ends(path: Path, line: SimulatedLine) -> None:
    """Without loop each step is done once; a fault without a station is the line's."""
    path.write_text("steps: [{at: 0, fault: echo}, {at: 1s, fault: silent, times: 3}]")
    read = load_scenario(path, {"main": line})
    assert read.period_s is None
    assert read.steps == (
        ScenarioStep(0.0, False, PutFault(line, FaultKind.ECHO, None, 1.0, None, None)),
        ScenarioStep(1.0, False, PutFault(line, FaultKind.SILENT, None, 1.0, 3, None)),
    )


def test_several_lines(path: Path, line: SimulatedLine) -> None:
    """With several lines a step says which one it is about."""
    attic = SimulatedLine("modbus-rtu", 9600, [SimulatedModule(DIO100, 7)], name="attic")
    path.write_text("steps: [{at: 1s, line: attic, station: 7, input: 1, set: OFF}]")
    read = load_scenario(path, {"main": line, "attic": attic})
    assert read.steps[0].action == DriveInput(attic.module(7), 1, InputWord.OFF)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", ":1:1: the file is empty"),
        ("steps: [", "YAML: while parsing"),
        ("loop: true", ":1:1: steps is missing"),
        ("steps: []\nspeed: 2", ":2:1: unknown key speed"),
        ("steps: [{at: 1, station: 1, input: 1, set: ON}]", ":1:14: steps[0].at: 1 is not a dur"),
        ("steps: [{station: 1, input: 1, set: ON}]", ":1:9: steps[0]: a step has one of at and ev"),
        (
            "steps: [{at: 1s, every: 1s, station: 1, input: 1, set: ON}]",
            ":1:9: steps[0]: a step has one of at and every",
        ),
        ("steps: [{at: 1s, station: 1, set: ON}]", "one of input, module, fault"),
        ("steps: [{at: 1s, station: 1, input: 1, module: away}]", "one of input, module, fault"),
        ("steps: [{at: 1s, input: 1, set: ON}]", "station is missing"),
        ("steps: [{at: 1s, station: 3, input: 1, set: ON}]", "no module is at station 3 of line m"),
        ("steps: [{at: 1s, station: 2, input: 1, set: ON}]", "a DO100 has no inputs"),
        ("steps: [{at: 1s, station: 1, input: 17, set: ON}]", "17 is out of range"),
        ("steps: [{at: 1s, station: 1, input: 1}]", "set is missing"),
        ("steps: [{at: 1s, station: 1, input: 1, set: on}]", "did you mean ON?"),
        ("steps: [{at: 1s, station: 1, module: gone}]", "gone is not known here"),
        ("steps: [{at: 1s, fault: silnet}]", "did you mean silent?"),
        ("steps: [{at: 1s, fault: echo, station: 1}]", ":1:40: steps[0].station: echo is the ada"),
        ("steps: [{at: 1s, fault: silent, probability: 2}]", "up to 1"),
        ("steps: [{at: 1s, fault: silent, input2: 2}]", "unknown key input2"),
        ("steps: [{at: 1s, line: attic, fault: silent}]", "attic is not known here"),
        ("loop: true\nsteps: [{at: 0s, fault: echo}]", ":1:7: loop: there is nothing to repeat"),
    ],
)
def test_mistakes(path: Path, line: SimulatedLine, text: str, told: str) -> None:
    """Each mistake is one line with its place, and is not followed by false ones."""
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_scenario(path, {"main": line})
    (problem,) = caught.value.problems
    assert str(problem).startswith(f"{path}:")
    assert told in str(problem)
    assert "\n" not in str(problem)


def test_several_lines_and_no_name(path: Path, line: SimulatedLine) -> None:
    """Which line is meant has to be said."""
    path.write_text("steps: [{at: 1s, station: 1, input: 1, set: ON}]")
    with pytest.raises(ConfigError, match="say line: main or attic"):
        load_scenario(path, {"main": line, "attic": line})


@pytest.mark.parametrize("content", [None, b"\xff\xfe"])
def test_unreadable_file(path: Path, line: SimulatedLine, content: bytes | None) -> None:
    """A file that is not there, or is no text, is one line too."""
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"scenario\.yaml:1:1: the scenario cannot be read"):
        load_scenario(path, {"main": line})


def test_fault_on_and_off(line: SimulatedLine) -> None:
    """A fault is put on as asked for, strikes so often, and is taken off again."""
    PutFault(line, FaultKind.LATE, 1, 1.0, 2, 0.3).do()
    PutFault(line, FaultKind.SILENT, None, 1.0, None, None).do()
    struck = [line.faults.draw(FaultKind.LATE, b"#01RDI\r", 1) for _ in range(3)]
    assert [fault.delay_s for fault in struck if fault] == [0.3, 0.3]
    assert line.faults.draw(FaultKind.SILENT, b"#01RDI\r", 1)
    TakeFault(line, FaultKind.SILENT, None).do()
    assert not line.faults.draw(FaultKind.SILENT, b"#01RDI\r", 1)
