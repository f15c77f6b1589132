"""The parts of a rule: inputs and their states, and what is ordered of outputs and covers."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from bridge.config.nodes import Place, Reader, WrongValueError, entries, nearest
from bridge.config.scalars import choice
from bridge.config.schema import InputConfig, InputState, OutputConfig, RuleOrder, StationConfig
from bridge.config.shapes import looking, named, shaped, words
from bridge.config.text import TEXT, text
from bridge.model import Word, bit, channels_of

_INPUT = re.compile(r"(?P<station>[^/]+)/di/(?P<channel>[1-9][0-9]?)")
_TARGET = re.compile(r"(?P<station>[^/]+)/(?P<name>do/[1-9][0-9]?|cover/[^/]+)")
_INPUT_NAME = r"^[a-z0-9_-]+/di/[1-9][0-9]?$"
_TARGET_NAME = r"^[a-z0-9_-]+/(do/[1-9][0-9]?|cover/[a-z0-9_-]+)$"
STATES: Mapping[str, bool] = {"ON": True, "OFF": False}
_OUTPUT_WORDS = {str(word): str(word) for word in Word}
_COVER_WORDS = {word: word for word in ("OPEN", "CLOSE", "STOP")}


@dataclass(frozen=True, slots=True)
class Stations:
    """The stations by their ids; `is_whole`: none of them was left out because it is wrong."""

    stations: Mapping[str, StationConfig]
    is_whole: bool


# --- inputs -----------------------------------------------------------------------------------


def input_of(known: Stations) -> Reader[tuple[StationConfig, InputConfig] | None]:
    """Return a reader of `when`."""
    return shaped(lambda place: _input(place, text(place), known), TEXT)


def _input(place: Place, written: str, known: Stations) -> tuple[StationConfig, InputConfig] | None:
    """Return the input that is written so; None: its station has a problem of its own."""
    match = _INPUT.fullmatch(written)
    if match is None:
        raise WrongValueError(f"{written!a} is no input; write one as STATION/di/N: garage/di/3")
    config = _station(place, match["station"], known)
    if config is None:
        return None
    for channel in config.inputs:
        if channel.channel == int(match["channel"]):
            return config, channel
    raise WrongValueError(f"station {config.id} has no input {match['channel']}; {_has(config)}")


def _has(config: StationConfig) -> str:
    if not config.inputs:
        return f"a {config.model.name} has none, or all are left out"
    return f"it has {', '.join(str(channel.channel) for channel in config.inputs)}"


def _station(place: Place, name: str, known: Stations) -> StationConfig | None:
    config = known.stations.get(name)
    if config is not None:
        return config
    if not known.is_whole or place.source.shapes is not None:
        return None  # it may be one of those that could not be read
    meant = nearest(name, known.stations)
    advice = f"did you mean {meant}?" if meant else f"there are {', '.join(known.stations)}"
    raise WrongValueError(f"there is no station {name!a}; {advice}")


def conditions_of(known: Stations) -> Reader[tuple[InputState, ...]]:
    """Return a reader of `while`."""

    def read(place: Place) -> tuple[InputState, ...]:
        found = []
        for name, entry in entries(place).items():
            on = entry.value.read(choice(STATES), None)
            at = entry.key.read(partial(_input, written=name, known=known), None)
            if on is not None and at is not None:
                found.append(InputState(at[0].id, at[1].channel, on))
        return tuple(found)

    return looking(read, lambda _: named(_INPUT_NAME, words(*STATES)))


# --- orders -----------------------------------------------------------------------------------


def orders_of(known: Stations) -> Reader[tuple[RuleOrder, ...]]:
    """Return a reader of `then`."""

    def read(place: Place) -> tuple[RuleOrder, ...]:
        found = list[RuleOrder]()
        listed = entries(place)
        for name, entry in listed.items():
            read_order = partial(_order, name=name, value=entry.value, known=known)
            order = entry.key.read(read_order, None)
            if order is not None:
                _check_together(entry.key, order, found, known.stations[order.station_id])
                found.append(order)
        if not listed:
            raise WrongValueError("orders nothing; write what to do, such as {hall/do/2: TOGGLE}")
        return tuple(found)

    return looking(read, lambda _: named(_TARGET_NAME, words(*_OUTPUT_WORDS, *_COVER_WORDS)))


def _order(key: Place, name: str, value: Place, known: Stations) -> RuleOrder | None:
    match = _TARGET.fullmatch(name)
    if match is None:
        raise WrongValueError(
            f"{name!a} is no output and no cover; write STATION/do/N or STATION/cover/ID"
        )
    config = _station(key, match["station"], known)
    if config is None:
        return None
    kind, _, which = match["name"].partition("/")
    if kind == "cover":
        mask = _cover_outputs(config, which)
        word = value.read(choice(_COVER_WORDS), None)
    else:
        output = _output(config, int(which))
        mask = bit(output.channel)
        word = value.read(choice(_OUTPUT_WORDS), None)
        if word is not None and (objection := _objection(config, output, word)):
            value.problem(objection)
            return None
    return None if word is None else RuleOrder(config.id, match["name"], word, mask)


def _cover_outputs(config: StationConfig, name: str) -> int:
    for cover in config.covers:
        if cover.id == name:
            return cover.outputs
    raise WrongValueError(f"station {config.id} has no cover {name!a}; look at its covers")


def _output(config: StationConfig, channel: int) -> OutputConfig:
    for output in config.outputs:
        if output.channel == channel:
            return output
    there = ", ".join(str(output.channel) for output in config.outputs)
    raise WrongValueError(f"station {config.id} has no output {channel}; it has {there}")


def _objection(config: StationConfig, output: OutputConfig, word: str) -> str | None:
    """Return why this word cannot be said to that output; None: it can."""
    if output.read_only:
        return "that output is read_only; take one of the two out"
    if config.cover_outputs & bit(output.channel) and word != Word.OFF:
        return "that output drives a cover; command the cover, as STATION/cover/ID: OPEN"
    if word == Word.TOGGLE and output.mode == "pulse":
        return "a pulse goes OFF by itself and is not toggled; write PRESS"
    if word == Word.PRESS and output.mode != "pulse":
        return "PRESS is for a pulse; write mode: pulse at that output, or ON here"
    return None


def _check_together(
    key: Place, order: RuleOrder, before: Sequence[RuleOrder], config: StationConfig
) -> None:
    """Report an order that cannot stand beside an earlier one of the same rule."""
    for other in before:
        if other.station_id != order.station_id:
            continue
        if other.mask & order.mask:
            key.problem(f"names an output that {other.target} names; write one of the two")
        elif {order.word, other.word} <= {Word.ON, Word.PRESS, Word.TOGGLE}:
            both = order.mask | other.mask
            if any((group & both).bit_count() > 1 for group in config.interlock):
                these = " and ".join(map(str, channels_of(both)))
                key.problem(f"outputs {these} are interlocked: only one of them may go ON")
