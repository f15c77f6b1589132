"""Orders that a person types while modules run."""

from collections.abc import Mapping

import pytest

from bridge.model import DIO100, DO100
from bridge.simulator import SimulatedLine, SimulatedModule
from bridge.simulator.control import ControlError, read_order, show


def lines_named(*names: str) -> Mapping[str, SimulatedLine]:
    """Lines that do not run, with a DIO100 at 1 and a DO100 at 2 each."""
    return {
        name: SimulatedLine(
            "wisco", 9600, [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)], name=name
        )
        for name in names
    }


@pytest.mark.parametrize(
    ("before", "order", "after"),
    [
        (0, "1 di/3 ON", 0b100),
        (0b100, "1 di/3 ON", 0b100),
        (0b100, "1 di/3 OFF", 0),
        (0b100, "1 di/3 TOGGLE", 0),
        (0b100, "  1   di/16 TOGGLE  ", 0x8004),
        (0, "main/1 di/1 ON", 1),
    ],
)
def test_inputs_are_driven(before: int, order: str, after: int) -> None:
    """ON, OFF and TOGGLE do to an input what they say; the only line needs no name."""
    lines = lines_named("main")
    module = lines["main"].module(1)
    module.set_input(3, bool(before))
    read_order(order, lines).do()
    assert module.inputs == after


def test_module_goes_and_comes_back() -> None:
    """`away` takes a module off its line, `back` puts it there again."""
    lines = lines_named("main", "attic")
    read_order("attic/2 away", lines).do()
    assert lines["attic"].module(2).away
    assert not lines["main"].module(2).away
    read_order("attic/2 back", lines).do()
    assert not lines["attic"].module(2).away


@pytest.mark.parametrize(
    ("order", "told"),
    [
        ("help", "'help' is not understood: write `1 di/3 ON`"),
        ("1 do/3 ON", "is not understood"),
        ("1 di/3", "is not understood"),
        ("1 di/3 on", "on is not ON, OFF or TOGGLE"),
        ("1 di/17 ON", "station 1, a DIO100, has no input 17: it has 16"),
        ("1 di/0 ON", "has no input 0"),
        ("2 di/1 ON", "station 2, a DO100, has no input 1: it has 0"),
        ("3 away", "no module is at station 3 of main: there is 1, 2"),
        ("cellar/1 away", "there is no line cellar: there is main"),
    ],
)
def test_what_cannot_be_done_is_told(order: str, told: str) -> None:
    """One clear line for each slip."""
    with pytest.raises(ControlError) as caught:
        read_order(order, lines_named("main"))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_several_lines_want_a_name() -> None:
    """With several lines the station alone is not enough."""
    with pytest.raises(ControlError, match=r"which line.* main, attic"):
        read_order("1 away", lines_named("main", "attic"))


def test_show() -> None:
    """Each module is one line: what is ON there, and whether it is away."""
    lines = lines_named("main")
    lines["main"].module(1).set_input(3, True)
    lines["main"].module(1).set_input(16, True)
    lines["main"].module(2).set_output(9, True)
    lines["main"].module(2).away = True
    assert list(show(lines)) == [
        "1 DIO100: inputs ON 3, 16; outputs ON none",
        "2 DO100 (away): outputs ON 9",
    ]
    assert next(iter(show(lines_named("main", "attic")))).startswith("main/1 DIO100:")
