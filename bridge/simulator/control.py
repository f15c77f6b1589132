"""Reads what a person types while the modules run, and shows the modules."""

import re
from collections.abc import Iterator, Mapping

from bridge.errors import BridgeError
from bridge.model import channels_of
from bridge.simulator.actions import Action, DriveInput, InputWord, MoveModule
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule

USAGE = "write `1 di/3 ON` (or OFF, TOGGLE), `1 away`, `1 back` or `show`"

_ORDER = re.compile(
    r"(?:(?P<line>[^\s/]+)/)?(?P<station>[0-9]{1,2})\s+"
    r"(?:di/(?P<input>[0-9]{1,2})\s+(?P<word>\w+)|(?P<move>away|back))"
)


class ControlError(BridgeError):
    """The typed line cannot be carried out; the text says why."""


def read_order(text: str, lines: Mapping[str, SimulatedLine]) -> Action:
    """Return the action of one line such as `1 di/3 ON`, or `main/1 away` with several lines.

    Raises:
        ControlError: It is not an order, or it names an unknown line or station.
    """
    match = _ORDER.fullmatch(text.strip())
    if match is None:
        raise ControlError(f"{text.strip()!r} is not understood: {USAGE}")
    module = _module(_line(match["line"], lines), int(match["station"]))
    if match["move"]:
        return MoveModule(module, match["move"] == "away")
    return DriveInput(module, _channel(module, int(match["input"])), _word(match["word"]))


def show(lines: Mapping[str, SimulatedLine]) -> Iterator[str]:
    """Yield one line of text for each module."""
    for line in lines.values():
        for module in line.modules.values():
            state = " (away)" if module.away else ""
            inputs = f" inputs ON {_listed(module.inputs)};" if module.model.inputs else ""
            outputs = f" outputs ON {_listed(module.outputs)}"
            name = place_of(line.name, module.address, several=len(lines) > 1)
            yield f"{name} {module.model.name}{state}:{inputs}{outputs}"


def place_of(line: str, address: int, *, several: bool) -> str:
    """Return the name of a module; it begins with the line only if there are several lines."""
    return f"{line}/{address}" if several else str(address)


def _line(name: str | None, lines: Mapping[str, SimulatedLine]) -> SimulatedLine:
    if name is None and len(lines) == 1:
        return next(iter(lines.values()))
    if name is None:
        raise ControlError(f"which line? put one of {', '.join(lines)} and a / in front")
    if name not in lines:
        raise ControlError(f"there is no line {name}: there is {', '.join(lines)}")
    return lines[name]


def _module(line: SimulatedLine, address: int) -> SimulatedModule:
    if address not in line.modules:
        there = ", ".join(map(str, line.modules))
        raise ControlError(f"no module is at station {address} of {line.name}: there is {there}")
    return line.modules[address]


def _channel(module: SimulatedModule, channel: int) -> int:
    if not 1 <= channel <= module.model.inputs:
        raise ControlError(
            f"station {module.address}, a {module.model.name}, has no input {channel}: "
            f"it has {module.model.inputs}"
        )
    return channel


def _word(word: str) -> InputWord:
    try:
        return InputWord(word)
    except ValueError:
        raise ControlError(f"{word} is not ON, OFF or TOGGLE") from None


def _listed(bits: int) -> str:
    return ", ".join(map(str, channels_of(bits))) or "none"
