"""How a panel draws a module: text and styles, without a terminal."""

from dataclasses import dataclass
from typing import Self

from bridge.model import ModuleType, bit
from bridge.simulator.module import SimulatedModule

INPUT_ROWS = (1, 2)

_MARGIN = 7
_CELL = 4
COLUMNS = _MARGIN + 16 * _CELL + 1  # what a module with every channel takes
_LEDS = {True: "●", False: "○"}  # lit and dark also differ without colours

Span = tuple[str, str]  # a text and its style; rows end with a line feed


@dataclass(frozen=True, slots=True)
class Look:
    """Describe what is to be seen of a module at one moment; bits as in the module.

    Attributes:
        away: Why it is not there, in words; empty: it is there.
    """

    away: str
    inputs: int
    outputs: int
    pulse: int

    @classmethod
    def at(cls, module: SimulatedModule) -> Self:
        """Return the present state."""
        away = "away: it hears and says nothing" if module.away else ""
        return cls(away, module.inputs, module.outputs, module.settings.pulse)


def rows_of(model: ModuleType) -> int:
    """Return the number of rows: the title, and two for inputs and for outputs each."""
    return 1 + 2 * bool(model.inputs) + 2 * bool(model.outputs)


def draw(
    name: str, model: ModuleType, look: Look, cursor: int | None, columns: int = COLUMNS
) -> list[Span]:
    """Draw the rows of one module; `cursor`: its chosen input, 0 where it has none.

    Where there are fewer `columns` than it takes, `+4` tells of channels that are left out.
    """
    title = "bold reverse" if cursor == 0 else "bold" if cursor is None else "bold underline"
    away = f"  {look.away}" if look.away else ""
    spans = [(f" {name} {model.name}", title), (f"{away}\n", "ansi_yellow")]
    spans += _bank("in", model.inputs, look.inputs, 0, cursor, columns=columns)
    spans += _bank("out", model.outputs, look.outputs, look.pulse, None, columns=columns)
    return spans


def input_at(x: int, y: int, model: ModuleType) -> int | None:
    """Return the input at this column and row of the module, both counted from 0."""
    channel = (x - _MARGIN) // _CELL + 1
    return channel if y in INPUT_ROWS and 1 <= channel <= model.inputs else None


def _bank(
    name: str, channels: int, lit: int, pulse: int, cursor: int | None, *, columns: int
) -> list[Span]:
    if not channels:
        return []
    shown = _fitting(channels, columns)
    numbers = [(f"   {name:<{_MARGIN - 3}}", "dim")]
    leds = [(" " * _MARGIN, "")]
    for channel in range(1, shown + 1):
        chosen = " reverse" if channel == cursor else ""
        on = bool(lit & bit(channel))
        label = f"{channel}p" if pulse & bit(channel) else str(channel)
        numbers.append((f"{label:>{_CELL - 1}} ", "dim" + chosen))
        leds.append(
            (f"{_LEDS[on]:>{_CELL - 1}} ", ("bold ansi_bright_green" if on else "dim") + chosen)
        )
    if left_out := channels - shown:
        numbers.append((f"+{left_out}", "ansi_yellow"))
    return [*numbers, ("\n", ""), *leds, ("\n", "")]


def _fitting(channels: int, columns: int) -> int:
    """Return how many channels fit, with a mark of those that do not."""
    if _MARGIN + channels * _CELL <= columns:
        return channels
    return max(0, columns - _MARGIN - _CELL) // _CELL
