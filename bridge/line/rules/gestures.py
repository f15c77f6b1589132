"""Recognises presses of a button. Time is an argument (`bridge.clock.boot_s`).

Each read of the inputs is an instant; nothing is known between two of them. So a gesture is
reported by the first read at or after the instant that decides it. If two reads are farther apart
than a long press, the gesture in progress is dropped, because it may have been anything.
"""

import math
from collections.abc import Iterable, Mapping
from enum import Enum

from bridge.config.schema import GestureConfig, InputConfig
from bridge.model import Gesture, bit


class _Phase(Enum):
    RESTING = "released, and nothing waits"
    PRESSED = "pressed, and not yet for long"
    RELEASED = "released after a short press: a second one may follow"
    SPENT = "pressed, and told already or begun unseen: the release means nothing"


class Button:
    """One input. Pressed is ON, as published."""

    __slots__ = ("_config", "_on", "_phase", "_since")

    def __init__(self, config: GestureConfig) -> None:
        self._config = config
        self._phase = _Phase.RESTING
        self._on = False
        self._since = 0.0

    @property
    def busy(self) -> bool:
        """Return whether time alone can complete a gesture."""
        return self._phase in {_Phase.PRESSED, _Phase.RELEASED}

    def observe(self, on: bool, now: float, unseen_s: float) -> Gesture | None:
        """Return the gesture that this value completes; the last read was `unseen_s` ago."""
        if unseen_s > self._config.long_s:
            self._begin(on)
            return None
        told = self._over(now)
        if on == self._on:
            return told
        self._on = on
        return (self._press(now) if on else self._release(now)) or told  # at most one of them

    def _begin(self, on: bool) -> None:
        """Begin anew, because earlier values are not known: a press from before does not count."""
        self._on = on
        self._phase = _Phase.SPENT if on else _Phase.RESTING

    def _over(self, now: float) -> Gesture | None:
        """Return the gesture that the passed time completes."""
        lasted_s = now - self._since
        if self._phase is _Phase.PRESSED and lasted_s >= self._config.long_s:
            self._phase = _Phase.SPENT
            return Gesture.LONG
        if self._phase is _Phase.RELEASED and lasted_s >= self._config.double_s:
            self._phase = _Phase.RESTING
            return Gesture.SHORT
        return None

    def _press(self, now: float) -> Gesture | None:
        if self._phase is _Phase.RELEASED:
            self._phase = _Phase.SPENT
            return Gesture.DOUBLE
        self._phase, self._since = _Phase.PRESSED, now
        return None

    def _release(self, now: float) -> Gesture | None:
        pressed, self._phase, self._since = self._phase, _Phase.RESTING, now
        if pressed is _Phase.SPENT:
            return None
        if self._config.double_s > 0:
            self._phase = _Phase.RELEASED
            return None
        return Gesture.SHORT


class Buttons:
    """The inputs of a module that are buttons."""

    __slots__ = ("_busy", "_buttons", "_inputs", "_read_at")

    def __init__(self, buttons: Mapping[int, Button]) -> None:
        self._buttons = buttons
        self.forget()

    def forget(self) -> None:
        """Drop gestures in progress: the module is gone."""
        self._inputs: int | None = None
        self._read_at = -math.inf
        self._busy = False

    def observe(self, inputs: int, now: float) -> list[tuple[int, Gesture]]:
        """Return the gestures that a read of the inputs completes; call it for each read."""
        unseen_s, self._read_at = now - self._read_at, now
        if inputs == self._inputs and not self._busy:
            return []
        self._inputs = inputs
        made = [
            (channel, gesture)
            for channel, button in self._buttons.items()
            if (gesture := button.observe(bool(inputs & bit(channel)), now, unseen_s)) is not None
        ]
        self._busy = any(button.busy for button in self._buttons.values())
        return made


def buttons_among(inputs: Iterable[InputConfig]) -> Buttons | None:
    """Return the buttons among the inputs; None: there are none."""
    buttons = {c.channel: Button(c.gestures) for c in inputs if c.gestures is not None}
    return Buttons(buttons) if buttons else None
