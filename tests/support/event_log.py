"""Collects what a thread emits, and waits until the wanted is there."""

import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

import pytest

from bridge.mqtt.events import MqttEvent

E = TypeVar("E", bound=MqttEvent)

WAIT_S = 20.0  # generous: a wait ends as soon as its condition holds


class EventLog:
    """Give it to an `MqttClient` as `emit`."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # its lock may be taken again by one thread
        self._events: list[MqttEvent] = []

    def __call__(self, event: MqttEvent) -> None:
        """Takes an event, from any thread."""
        with self._changed:
            self._events.append(event)
            self._changed.notify_all()

    @property
    def all(self) -> list[MqttEvent]:
        """Everything so far, oldest first."""
        with self._changed:
            return list(self._events)

    def of(self, kind: type[E]) -> list[E]:
        """Return the events of one kind, oldest first."""
        return [event for event in self.all if isinstance(event, kind)]

    def wait(self, kind: type[E], count: int = 1) -> E:
        """Waits for the `count`-th event of this kind since the start, and returns it."""
        self.wait_for(lambda: len(self.of(kind)) >= count, f"{count} {kind.__name__}")
        return self.of(kind)[count - 1]

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        """Waits until `condition` holds; it is asked after each event."""
        with self._changed:
            held = self._changed.wait_for(condition, WAIT_S)
            assert held, f"no {what} after {WAIT_S} s; seen: {self._events}"


def wait_until(condition: Callable[[], bool]) -> None:
    """Ask repeatedly until something is true that sends no event."""
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, f"the condition does not hold after {WAIT_S} s"
        time.sleep(0.005)


def warnings_in(caplog: pytest.LogCaptureFixture) -> list[str]:
    """The lines of the log from warnings upwards."""
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
