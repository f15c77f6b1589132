"""The commands to the outputs, and which frames may carry them out."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

PATIENCE_S = 2.0
LATCH_TIMES, PULSE_TIMES = 2, 1

Use = tuple[float, bool]  # when a frame ordered an output, and what


@dataclass(eq=False)
class Wish:
    """One command that arrived.

    Attributes:
        values: By output what is asked; None: the other of what it is (TOGGLE).
        cover: The outputs of a cover, where it is for one: any of them may go ON.
        barred: Why nothing may come of it; None: it may.
        uses: By output the instants of frames that were taken for it.
        judged: Its status, when a verdict on it was told.
        by: The rule that it is an order of; then it may also come to nothing.
        held: Whether the rule cannot have acted on it by now.
        held_at: The instants of frames at which it was held.
        slack_s: How long its event may take to be decided.
    """

    station_id: str
    target: str
    payload: Any
    command_id: str | None
    arrived: float
    deadline: float
    values: dict[int, bool | None]
    press: bool = False
    barred: str | None = None
    uses: dict[int, list[Use]] = field(default_factory=dict)
    judged: str | None = None
    judged_at: float = 0.0
    setting: bool = False
    by: str | None = None
    held: Callable[[], bool] = lambda: False
    held_at: set[float] = field(default_factory=set)
    slack_s: float = 0.0

    @property
    def key(self) -> tuple[str, str, str]:
        """By what a verdict names it."""
        return key_of(self.station_id, self.target, self.payload, self.command_id)

    def wants(self, output: int, value: bool) -> bool:
        """Tell whether it asks for that."""
        if output not in self.values:
            return False
        wanted = self.values[output]
        if wanted is not None:
            return wanted is value
        return all(one is value for _, one in self.uses.get(output, ()))

    def may(self, output: int, value: bool, at: float, times: int) -> bool:
        """Tell whether a frame of that instant can be for it, as one of so many."""
        return (
            self.barred is None
            and (self.judged is None or self.judged_at >= at)
            and self.arrived <= at <= self.deadline + 0.001
            and self.wants(output, value)
            and len(self.uses.get(output, ())) < times
            and at not in self.held_at
        )

    def look(self, at: float) -> None:
        """Note whether it is held, as a frame goes out."""
        if self.by is not None and self.arrived <= at <= self.deadline and self.held():
            self.held_at.add(at)

    def rank(self, output: int, *, pulse: bool) -> tuple[bool, bool, float]:
        """Return how likely a frame is for another wish: the least is taken."""
        toggle = self.values[output] is None
        return (self.press and not pulse, toggle, self.deadline)

    def fits(self, output: int, use: Use) -> bool:
        """Tell whether a frame can be for it, whatever else is."""
        at, value = use
        return (
            self.barred is None
            and (self.judged is None or self.judged_at >= at)
            and self.arrived <= at <= self.deadline + 0.001
            and self.values[output] in {None, value}
            and at not in self.held_at
        )

    def use(self, output: int, at: float, value: bool) -> None:
        """Take a frame for it."""
        self.uses.setdefault(output, []).append((at, value))


def match_all(
    uses: Sequence[Use],
    wishes: Sequence[tuple[Wish, int]],
    output: int,
    by_rule: Callable[[Use], bool],
) -> list[tuple[Wish, Use]] | None:
    """Give each frame to a wish that it fits, so many to one at the most; None: that cannot be.

    `by_rule` tells of a frame that is left over whether a rule of the house explains it.
    """
    given: dict[tuple[int, int], int] = {}  # a place at a wish: the frame there

    def place(frame: int, tried: set[tuple[int, int]]) -> bool:
        for at, (wish, times) in enumerate(wishes):
            if not wish.fits(output, uses[frame]):
                continue
            for seat in ((at, n) for n in range(times)):
                if seat in tried:
                    continue
                tried.add(seat)
                if seat not in given or place(given[seat], tried):
                    given[seat] = frame
                    return True
        return False

    for frame, use in enumerate(uses):
        if not place(frame, set()) and not by_rule(use):
            return None
    return [(wishes[seat[0]][0], uses[frame]) for seat, frame in given.items()]


def key_of(station_id: str, target: str, payload: Any, command_id: Any) -> tuple[str, str, str]:
    """Return by what a command and its verdict are told from others."""
    if command_id is not None:
        return station_id, target, f"id {command_id}"
    return station_id, target, json.dumps(payload, sort_keys=True)


def read_wish(topic: str, payload: bytes, now: float, covers: dict[str, int]) -> Wish | None:
    """Return what a command asks for; None: it is none.

    Args:
        topic: Where it came.
        payload: What it says.
        now: When it arrived.
        covers: By station the outputs of its cover, as bits.
    """
    parts = topic.split("/")
    if len(parts) < 3 or parts[-1] != "set" or parts[1] == "bridge" or "bridge" in parts[1:-1]:
        return None
    station_id, target = parts[1], "/".join(parts[2:-1])
    text = payload.decode()
    is_position = target == "cover/blind/position"
    target = target.removesuffix("/position")
    document: Any = json.loads(text) if text.startswith("{") else {}
    command_id = document.get("id")
    deadline = now + document.get("deadline", PATIENCE_S)
    asked = document.get("state", document.get("do", document.get("position", text)))
    if is_position:
        asked = int(asked)
    wish = Wish(station_id, target or "do", asked, command_id, now, deadline, {})
    if target.startswith("cover"):
        bits = covers.get(station_id, 0)
        if asked != "STOP":
            wish.values = {n: True for n in range(1, 17) if bits >> (n - 1) & 1}
    elif target.count("/") > 1:
        wish.setting = True
        asked = document.get("mode", document.get("hold", text))
        wish.payload = asked
    elif isinstance(asked, dict):
        wish.values = {int(n): value == "ON" for n, value in asked.items()}
    elif asked in {"ON", "OFF", "TOGGLE", "PRESS"}:
        n = int(parts[3])
        wish.press = asked == "PRESS"
        wish.values = {n: None if asked == "TOGGLE" else asked != "OFF"}
    return wish
