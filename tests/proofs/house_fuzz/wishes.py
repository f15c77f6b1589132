"""What was asked of the outputs, and what of it a frame may carry out."""

import json
from dataclasses import dataclass, field
from typing import Any

PATIENCE_S = 2.0
LATCH_TIMES, PULSE_TIMES = 2, 1


@dataclass(eq=False)
class Wish:
    """One command that arrived.

    Attributes:
        values: By output what is asked; None: the other of what it is (TOGGLE).
        cover: The outputs of a cover, where it is for one: any of them may go ON.
        barred: Why nothing may come of it; None: it may.
        uses: By output the instants of frames that were taken for it.
        judged: Its status, when a verdict on it was told.
    """

    station: str
    target: str
    payload: Any
    mark: str | None
    arrived: float
    deadline: float
    values: dict[int, bool | None]
    press: bool = False
    barred: str | None = None
    uses: dict[int, list[float]] = field(default_factory=dict)
    toggled: bool | None = None
    judged: str | None = None
    judged_at: float = 0.0
    setting: bool = False

    @property
    def key(self) -> tuple[str, str, str]:
        """By what a verdict names it."""
        return key_of(self.station, self.target, self.payload, self.mark)

    def wants(self, output: int, value: bool) -> bool:
        """Tell whether it asks for that."""
        if output not in self.values:
            return False
        wanted = self.values[output]
        if wanted is None:
            return self.toggled in {None, value}
        return wanted is value

    def use(self, output: int, value: bool, at: float) -> None:
        """Take a frame for it."""
        self.uses.setdefault(output, []).append(at)
        if self.values[output] is None:
            self.toggled = value


def key_of(station: str, target: str, payload: Any, mark: Any) -> tuple[str, str, str]:
    """Return by what a command and its verdict are told from others."""
    if mark is not None:
        return station, target, f"id {mark}"
    return station, target, json.dumps(payload, sort_keys=True)


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
    station, target = parts[1], "/".join(parts[2:-1])
    if target == "cover/blind/position":
        target = "cover/blind"
    text = payload.decode()
    document: Any = json.loads(text) if text.startswith("{") else {}
    mark = document.get("id")
    deadline = now + document.get("deadline", PATIENCE_S)
    asked = document.get("state", document.get("do", document.get("position", text)))
    wish = Wish(station, target or "do", asked, mark, now, deadline, {})
    if target.startswith("cover"):
        bits = covers.get(station, 0)
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
