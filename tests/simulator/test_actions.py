"""The actions of persons and scenarios on simulated lines."""

import pytest

from bridge.model import DIO100
from bridge.simulator import FaultKind, SimulatedLine, SimulatedModule
from bridge.simulator.actions import DriveInput, InputWord, MoveModule, PutFault, TakeFault


@pytest.fixture
def line() -> SimulatedLine:
    """A line that does not run, with a DIO100 at 1."""
    return SimulatedLine("wisco", 9600, [SimulatedModule(DIO100, 1)])


@pytest.mark.parametrize(
    ("word", "before", "after"),
    [
        (InputWord.ON, False, True),
        (InputWord.ON, True, True),
        (InputWord.OFF, True, False),
        (InputWord.TOGGLE, True, False),
        (InputWord.TOGGLE, False, True),
    ],
)
def test_input(line: SimulatedLine, word: InputWord, before: bool, after: bool) -> None:
    """An input becomes what the word says."""
    module = line.module(1)
    module.set_input(9, before)
    DriveInput(module, 9, word).do()
    assert module.inputs == after << 8


def test_module_away_and_back(line: SimulatedLine) -> None:
    """A module leaves its line and comes back."""
    MoveModule(line.module(1), True).do()
    assert line.module(1).away
    MoveModule(line.module(1), False).do()
    assert not line.module(1).away


def test_fault_on_and_off(line: SimulatedLine) -> None:
    """A fault is put on as asked for, strikes so often, and is taken off again."""
    PutFault(line, FaultKind.LATE, 1, 1.0, 2, 0.3).do()
    PutFault(line, FaultKind.SILENT, None, 1.0, None, None).do()
    struck = [line.faults.draw(FaultKind.LATE, b"#01RDI\r", 1) for _ in range(3)]
    assert [fault.delay_s for fault in struck if fault] == [0.3, 0.3]
    assert line.faults.draw(FaultKind.SILENT, b"#01RDI\r", 1)
    TakeFault(line, FaultKind.SILENT, None).do()
    assert not line.faults.draw(FaultKind.SILENT, b"#01RDI\r", 1)
