"""Draws a module for the panel of `simulate`: text and styles, without a terminal."""

from dataclasses import dataclass
from typing import Self

from bridge.model import ModuleType, bit
from bridge.simulator.module import SimulatedModule

INPUT_ROWS = (1, 2)

_MARGIN = 7
_CELL = 4
_LEDS = {True: "●", False: "○"}  # lit and dark also differ without colours

Span = tuple[str, str]  # a text and its style; rows end with a line feed


@dataclass(frozen=True, slots=True)
class Look:
    """The visible state of a module at one moment; bits as in the module."""

    away: bool
    inputs: int
    outputs: int
    pulse: int

    @classmethod
    def at(cls, module: SimulatedModule) -> Self:
        """Return the present state."""
        return cls(module.away, module.inputs, module.outputs, module.settings.pulse)


def rows_of(model: ModuleType) -> int:
    """Return the number of rows: the title, and two for inputs and for outputs each."""
    return 1 + 2 * bool(model.inputs) + 2 * bool(model.outputs)


def draw(name: str, model: ModuleType, look: Look, cursor: int | None) -> list[Span]:
    """Return the rows of one module; `cursor` is its selected input, 0 if it has none."""
    title = "bold reverse" if cursor == 0 else "bold" if cursor is None else "bold underline"
    away = "  away: it hears and says nothing" if look.away else ""
    spans = [(f" {name} {model.name}", title), (f"{away}\n", "ansi_yellow")]
    spans += _bank("in", model.inputs, look.inputs, 0, cursor)
    spans += _bank("out", model.outputs, look.outputs, look.pulse, None)
    return spans


def input_at(x: int, y: int, model: ModuleType) -> int | None:
    """Return the input at this column and row of the module, both counted from 0."""
    channel = (x - _MARGIN) // _CELL + 1
    return channel if y in INPUT_ROWS and 1 <= channel <= model.inputs else None


def _bank(name: str, channels: int, lit: int, pulse: int, cursor: int | None) -> list[Span]:
    if not channels:
        return []
    numbers = [(f"   {name:<{_MARGIN - 3}}", "dim")]
    leds = [(" " * _MARGIN, "")]
    for channel in range(1, channels + 1):
        chosen = " reverse" if channel == cursor else ""
        on = bool(lit & bit(channel))
        label = f"{channel}p" if pulse & bit(channel) else str(channel)
        numbers.append((f"{label:>{_CELL - 1}} ", "dim" + chosen))
        leds.append(
            (f"{_LEDS[on]:>{_CELL - 1}} ", ("bold ansi_bright_green" if on else "dim") + chosen)
        )
    return [*numbers, ("\n", ""), *leds, ("\n", "")]
