"""Plays a scenario: `Timeline` decides what is due, the thread of `Player` does it."""

import heapq
import threading
import time
from typing import Self

from bridge.simulator.actions import Action
from bridge.simulator.scenario import Scenario, ScenarioStep


class Timeline:
    """The times of the actions. Time is an argument: seconds since the start of the scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self._period_s = scenario.period_s
        self._coming = [(step.after_s, n, step) for n, step in enumerate(scenario.steps)]
        heapq.heapify(self._coming)

    def next_at(self) -> float | None:
        """Return when the next action is due; None: no more."""
        return self._coming[0][0] if self._coming else None

    def due(self, elapsed_s: float) -> list[Action]:
        """Return the actions that are due, by time and then by their order in the file."""
        actions = []
        while self._coming and self._coming[0][0] <= elapsed_s:
            at, number, step = heapq.heappop(self._coming)
            actions.append(step.action)
            again_s = self._again_s(step)
            if again_s:
                heapq.heappush(self._coming, (at + again_s, number, step))
        return actions

    def _again_s(self, step: ScenarioStep) -> float | None:
        return step.after_s if step.every else self._period_s


class Player:
    """Plays one scenario in its own thread, from `start` (or `with`) to `stop`."""

    def __init__(self, scenario: Scenario) -> None:
        self._timeline = Timeline(scenario)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._play, name="scenario")

    def start(self) -> None:
        """Start the scenario."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the scenario."""
        self._stopping.set()
        self._thread.join()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _play(self) -> None:
        began = time.monotonic()
        while (at := self._timeline.next_at()) is not None:
            if self._stopping.wait(max(0.0, began + at - time.monotonic())):
                return
            for action in self._timeline.due(time.monotonic() - began):
                action.do()
