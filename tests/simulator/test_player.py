"""The times of the steps of a scenario."""

import threading
import time

import pytest

from bridge.model import DIO100
from bridge.simulator import SimulatedModule
from bridge.simulator.actions import DriveInput, InputWord, MoveModule
from bridge.simulator.player import Player, Timeline
from bridge.simulator.scenario import Scenario, ScenarioStep

MODULE = SimulatedModule(DIO100, 1)
ON = DriveInput(MODULE, 1, InputWord.ON)
OFF = DriveInput(MODULE, 1, InputWord.OFF)
AWAY = MoveModule(MODULE, True)


def test_steps_come_in_the_order_of_time() -> None:
    """Steps come once, by time, and at one instant in the order of the file."""
    steps = (
        ScenarioStep(2.0, False, OFF),
        ScenarioStep(1.0, False, ON),
        ScenarioStep(1.0, False, AWAY),
    )
    timeline = Timeline(Scenario(steps, None))
    assert timeline.next_at() == 1.0
    assert timeline.due(0.9) == []
    assert timeline.due(1.0) == [ON, AWAY]
    assert timeline.next_at() == 2.0
    assert timeline.due(5.0) == [OFF]
    assert timeline.next_at() is None


def test_every_comes_again_and_again() -> None:
    """`every: 2s` is due at 2, 4, 6 seconds; what was missed is made up for."""
    timeline = Timeline(Scenario((ScenarioStep(2.0, True, ON),), None))
    assert timeline.due(2.0) == [ON]
    assert timeline.due(3.9) == []
    assert timeline.due(8.0) == [ON, ON, ON]
    assert timeline.next_at() == 10.0


def test_loop_begins_again_at_the_last_step() -> None:
    """ON at 1 s, OFF at 3 s, looped: ON at 4, OFF at 6 seconds."""
    steps = (ScenarioStep(1.0, False, ON), ScenarioStep(3.0, False, OFF))
    timeline = Timeline(Scenario(steps, period_s=3.0))
    assert timeline.due(3.0) == [ON, OFF]
    assert timeline.next_at() == 4.0
    assert timeline.due(6.0) == [ON, OFF]


def test_player_plays_and_ends() -> None:
    """The thread does what is due, and stops in the middle when it is told."""
    module = SimulatedModule(DIO100, 1)
    steps = (
        ScenarioStep(0.0, False, DriveInput(module, 5, InputWord.ON)),
        ScenarioStep(0.05, False, DriveInput(module, 6, InputWord.TOGGLE)),
        ScenarioStep(3600.0, False, DriveInput(module, 7, InputWord.ON)),
    )
    with Player(Scenario(steps, None)):
        deadline = time.monotonic() + 10
        while module.inputs != 0b110000 and time.monotonic() < deadline:
            time.sleep(0.005)
    assert module.inputs == 0b110000
    assert not [thread for thread in threading.enumerate() if thread.name == "scenario"]


@pytest.mark.parametrize("steps", [(), (ScenarioStep(0.0, False, OFF),)])
def test_player_of_a_short_scenario_ends_by_itself(steps: tuple[ScenarioStep, ...]) -> None:
    """A scenario without further steps ends its thread, and `stop` is still allowed."""
    player = Player(Scenario(steps, None))
    player.start()
    player.stop()
