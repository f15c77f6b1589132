"""What `wisco2mqtt set` is asked for, read from its words."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bridge.cli.frame.usage import UsageError
from bridge.cli.send import understand
from bridge.config.durations import HOLD_DS, parse_duration, tenths
from bridge.model import Setting as SettingKind
from bridge.model import Word

_SETTING = re.compile(r"do/([1-9][0-9]?)/(mode|hold)")
_MODES = {"latch": 0, "pulse": 1}


@dataclass(frozen=True, slots=True)
class Switching:
    """Outputs, and the word for each.

    Attributes:
        target: As verdicts name it: `do/3`, or `do`.
        words: What was typed, for the printed line.
        payload: What verdicts repeat.
    """

    target: str
    words: str
    payload: Any
    states: Mapping[int, Word]


@dataclass(frozen=True, slots=True)
class Setting:
    """A mode or a hold time of one output; the rest is as in `Switching`."""

    target: str
    words: str
    payload: Any
    output: int
    setting: SettingKind
    value: int  # as in `SettingCommand`


Asked = Switching | Setting


def understand_words(words: list[str]) -> Asked:
    """Read TARGET and VALUE.

    Raises:
        UsageError: They are no command.
    """
    if len(words) != 2:  # noqa: PLR2004  # a target and a value
        raise UsageError("give a TARGET and a VALUE, such as do/3 ON")
    target, value = words
    if found := _SETTING.fullmatch(target):
        return _setting(target, value, int(found[1]), found[2])
    asked = understand(target, value)
    if target == "do":
        states = {int(output): Word(word) for output, word in asked.request["do"].items()}
        return Switching(target, asked.words, asked.request["do"], states)
    word = Word(asked.request["state"])
    return Switching(target, asked.words, word, {int(target.removeprefix("do/")): word})


def _setting(target: str, value: str, output: int, kind: str) -> Setting:
    if kind == "mode":
        if value not in _MODES:
            raise UsageError(f"{value} is no mode: give latch or pulse")
        return Setting(target, f"{target} {value}", value, output, SettingKind.MODE, _MODES[value])
    hold_ds = _hold_ds(value)
    if hold_ds is None or hold_ds not in HOLD_DS:
        raise UsageError(f"{value} is no hold time: give 0.1 to 25.5 seconds, in steps of 0.1 s")
    seconds = hold_ds / 10
    return Setting(target, f"{target} {seconds:g}", seconds, output, SettingKind.HOLD, hold_ds)


def _hold_ds(text: str) -> int | None:
    """Tenths of a second, of seconds without a unit or a time with one; None: it is none."""
    try:
        return tenths(parse_duration(text if text[-1:].isalpha() else f"{text}s"))
    except ValueError:
        return None
