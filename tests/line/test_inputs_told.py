"""Gestures and edges that a line worker reports, on a virtual line."""

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import CountConfig, GestureConfig, InputConfig
from bridge.model import (
    Gesture,
    GestureMade,
    InputsRose,
    LineChanged,
    LineProtocol,
    StationChanged,
    ValuesChanged,
)

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 102.0
BUTTON, METER = 2, 7
INPUTS = (
    InputConfig(1),
    InputConfig(BUTTON, gestures=GestureConfig()),
    InputConfig(METER, count=CountConfig()),
)


def worker_with(*inputs: InputConfig, protocol: LineProtocol = LineProtocol.WISCO) -> VirtualWorker:
    """A worker of one module with a button and a counted input, if nothing else is said."""
    return VirtualWorker(make_line(make_station(inputs=inputs or INPUTS), protocol=protocol))


def press_at(worker: VirtualWorker, instant: float, held_s: float, channel: int = BUTTON) -> None:
    """Press an input and release it."""
    module = worker.line.modules[1]
    worker.line.at(instant, lambda: module.set_input(channel, True))
    worker.line.at(instant + held_s, lambda: module.set_input(channel, False))


def gestures(worker: VirtualWorker) -> list[tuple[float, Gesture]]:
    """Return the gestures, with the time since T."""
    return [(at - T, e.gesture) for at, e in worker.events if isinstance(e, GestureMade)]


def edges(worker: VirtualWorker) -> int:
    """Return the number of counted edges."""
    rose = [event for _, event in worker.events if isinstance(event, InputsRose)]
    assert all(event == InputsRose("s1", 1 << (METER - 1)) for event in rose)
    return len(rose)


@pytest.mark.parametrize("protocol", list(LineProtocol))
@pytest.mark.parametrize(
    ("presses", "gesture", "due_s"),
    [
        ([(0.0, 0.3)], Gesture.SHORT, 0.7),
        ([(0.0, 1.5)], Gesture.LONG, 0.8),
        ([(0.0, 0.2), (0.4, 0.2)], Gesture.DOUBLE, 0.4),
    ],
)
def test_a_press_is_told_soon(
    protocol: LineProtocol,
    presses: list[tuple[float, float]],
    gesture: Gesture,
    due_s: float,
) -> None:
    """By the first read that can tell, though nothing may change any more."""
    worker = worker_with(protocol=protocol)
    for after_s, held_s in presses:
        press_at(worker, T + after_s, held_s)
    worker.run(T + 5)
    [(at, told)] = gestures(worker)
    assert told is gesture
    assert due_s <= at < due_s + 0.3


def test_the_state_comes_before_the_gesture_and_the_edge() -> None:
    """A state is published before its gesture and its edge."""
    both = InputConfig(1, gestures=GestureConfig(double_s=0.0), count=CountConfig())
    worker = worker_with(both)
    press_at(worker, T, 0.3, channel=1)
    worker.run(T + 5)
    assert worker.reported(T) == [
        ValuesChanged("s1", 1, 0),
        InputsRose("s1", 1),
        ValuesChanged("s1", 0, 0),
        GestureMade("s1", 1, Gesture.SHORT),
    ]


def test_other_inputs_are_no_buttons_and_not_counted() -> None:
    """Only what the configuration names tells more than its state."""
    worker = worker_with()
    press_at(worker, T, 0.3, channel=1)
    worker.run(T + 5)
    assert [type(event) for event in worker.reported(T)] == [ValuesChanged, ValuesChanged]


def test_each_rise_is_counted_and_no_fall() -> None:
    """Ten pulses are ten."""
    worker = worker_with()
    for n in range(10):
        press_at(worker, T + n * 0.5, 0.25, channel=METER)
    worker.run(T + 10)
    assert edges(worker) == 10


def test_an_inverted_input_is_counted_as_it_is_published() -> None:
    """An inverted input is counted when its contact opens."""
    worker = worker_with(InputConfig(METER, invert=True, count=CountConfig()))
    worker.line.at(T, lambda: worker.line.modules[1].set_input(METER, True))
    worker.run(T + 2)
    assert edges(worker) == 0
    worker = worker_with(InputConfig(METER, invert=True, count=CountConfig()))
    press_at(worker, T, 0.5, channel=METER)
    worker.run(T + 2)
    assert edges(worker) == 1


def test_a_flicker_is_no_edge_where_it_is_debounced() -> None:
    """A flicker that the debounce time hides is not counted."""
    worker = worker_with(InputConfig(METER, debounce_s=0.5, count=CountConfig()))
    press_at(worker, T, 0.2, channel=METER)
    press_at(worker, T + 2, 1.0, channel=METER)
    worker.run(T + 5)
    assert edges(worker) == 1


def test_a_flipped_bit_is_neither_a_press_nor_an_edge() -> None:
    """A change over unprotected frames counts after a second read (docs/failures.md C1)."""
    every = tuple(
        InputConfig(n, gestures=GestureConfig(), count=CountConfig()) for n in range(1, 17)
    )
    worker = worker_with(*every)
    count = 0

    def fault(_: bytes) -> Fault | None:
        nonlocal count
        count += 1
        return Fault.FLIP_REPLY if worker.line.now > T and count % 3 == 0 else None

    worker.line.fault = fault
    worker.run(T + 20)
    assert count > 500
    assert worker.reported(T) == []


@pytest.mark.parametrize("held_s", [0.3, 10.0])
def test_what_happens_while_the_module_is_away_is_not_made_up(held_s: float) -> None:
    """Pressed before or meanwhile: no gesture, and the first value afterwards is no edge."""
    worker = worker_with()
    module = worker.line.modules[1]
    press_at(worker, T, held_s)
    worker.line.at(T + 0.4, lambda: setattr(module, "away", True))
    worker.line.at(T + 4, lambda: module.set_input(METER, True))
    worker.line.at(T + 8, lambda: setattr(module, "away", False))
    worker.run(T + 30)
    assert [event.online for event in worker.reported(T) if isinstance(event, StationChanged)] == [
        False,
        True,
    ]
    assert gestures(worker) == []
    assert edges(worker) == 0


def test_what_happens_while_the_port_is_gone_is_not_made_up() -> None:
    """A press that was going on is dropped, and the next one is told."""
    worker = worker_with()
    module = worker.line.modules[1]
    press_at(worker, T, 1.0)
    worker.line.at(T + 0.3, lambda: setattr(worker.line, "fault", lambda _: Fault.PORT_GONE))
    worker.line.at(T + 0.5, lambda: module.set_input(METER, True))
    worker.line.at(T + 2, lambda: setattr(worker.line, "fault", lambda _: None))
    press_at(worker, T + 10, 0.3)
    worker.run(T + 15)
    assert LineChanged("main", online=False, detail="the port is gone") in worker.reported(T)
    assert [gesture for _, gesture in gestures(worker)] == [Gesture.SHORT]
    assert edges(worker) == 0
