"""Plays a scenario: what is due is decided by `Timeline`, done by the thread of `Player`."""

import heapq
import threading
import time
from types import TracebackType
from typing import Self

from bridge.simulator.actions import Action
from bridge.simulator.scenario import Scenario, ScenarioStep


class Timeline:
    """Describe which actions are due. Time comes in as an argument: seconds since the beginning."""

    def __init__(self, scenario: Scenario) -> None:
        self._period_s = scenario.period_s
        self._coming = [(step.after_s, n, step) for n, step in enumerate(scenario.steps)]
        heapq.heapify(self._coming)

    def next_at(self) -> float | None:
        """Return when something is due; None: never again."""
        return self._coming[0][0] if self._coming else None

    def due(self, elapsed_s: float) -> list[Action]:
        """Take what is due, in order of time, and within one instant of the file."""
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
    """Plays one scenario in a thread of its own, from `start` (or `with`) to `stop`."""

    def __init__(self, scenario: Scenario) -> None:
        self._timeline = Timeline(scenario)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._play, name="scenario")

    def start(self) -> None:
        """Note that the scenario begins."""
        self._thread.start()

    def stop(self) -> None:
        """Note that the scenario ends where it is."""
        self._stopping.set()
        self._thread.join()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()

    def _play(self) -> None:
        began = time.monotonic()
        while (at := self._timeline.next_at()) is not None:
            if self._stopping.wait(max(0.0, began + at - time.monotonic())):
                return
            for action in self._timeline.due(time.monotonic() - began):
                action.do()
