"""The section `rules`: what inputs do to outputs inside the bridge."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

from bridge.config.names import folded, id_from, identifier
from bridge.config.nodes import Place, Reader, WrongValueError, entries, items, nearest
from bridge.config.scalars import choice
from bridge.config.schema import (
    InputConfig,
    InputState,
    LineConfig,
    OutputConfig,
    RuleConfig,
    RuleOrder,
    StationConfig,
)
from bridge.config.shapes import looking, named, shaped, words
from bridge.config.tables import Table, Unique, table_of
from bridge.config.text import TEXT, label, text
from bridge.model import Gesture, Word, bit, channels_of

_INPUT = re.compile(r"(?P<station>[^/]+)/di/(?P<channel>[1-9][0-9]?)")
_TARGET = re.compile(r"(?P<station>[^/]+)/(?P<name>do/[1-9][0-9]?|cover/[^/]+)")
_STATES: Mapping[str, bool] = {"ON": True, "OFF": False}
_EVENTS = {word: word for word in (*_STATES, *Gesture)}
_OUTPUT_WORDS = {str(word): str(word) for word in Word}
_COVER_WORDS = {word: word for word in ("OPEN", "CLOSE", "STOP")}
_ONLY = {"always": False, "broker_away": True}


@dataclass(frozen=True, slots=True)
class _Stations:
    """The stations by their ids; `is_whole`: none of them was left out because it is wrong."""

    stations: Mapping[str, StationConfig]
    is_whole: bool


def rules_of(lines: Iterable[LineConfig]) -> Reader[tuple[RuleConfig, ...]]:
    """Return a reader of `rules` over the stations of these lines."""
    stations = {station.id: station for line in lines for station in line.stations}

    def read(place: Place) -> tuple[RuleConfig, ...]:
        known = _Stations(stations, is_whole=not place.source.problems)
        names, ids = Unique(), Unique()
        found = list[tuple[Place, RuleConfig]]()
        for item in items(place):
            rule = item.read(lambda place: _read_rule(place, known, names, ids), None)
            if rule is not None:
                found.append((item, rule))
        for (_, one), (at, other) in combinations(found, 2):
            _check_fight(at, one, other)
        return tuple(rule for _, rule in found)

    return read


def _read_rule(place: Place, known: _Stations, names: Unique, ids: Unique) -> RuleConfig | None:
    with table_of(place) as table:
        name = table.need("name", label, "write one that verdicts and Home Assistant show")
        rule_id = _read_id(table, name, ids)
        if name is not None:
            names.claim(name, table.place("name"), f"name {name}")
        when = table.need("when", _input_of(known), "write an input, such as garage/di/3")
        event = table.need("is", choice(_EVENTS), f"write one of {', '.join(_EVENTS)}")
        orders = table.need("then", _orders_of(known), "write what to do, as {hall/do/2: ON}")
        conditions = table.get("while", _conditions_of(known), ())
        broker_away = table.get("only", choice(_ONLY), False)
        if when is not None and event is not None:
            _check_event(table, when[1], event)
            _check_possible(table, when, event, conditions)
    if name is None or rule_id is None or when is None or event is None or not orders:
        return None
    station, channel = when
    return RuleConfig(
        rule_id, name, station.id, channel.channel, event, orders, conditions, broker_away
    )


def _read_id(table: Table, name: str | None, ids: Unique) -> str | None:
    rule_id = table.get("id", identifier, None)
    if "id" not in table and name is not None:
        rule_id = id_from(name)
        if rule_id in {"", "bridge"}:
            table.problem("name", "gives no id for topics; write an id beside it, such as stairs")
            return None
    if rule_id is not None:
        at = table.place("id" if "id" in table else "name")
        ids.claim(folded(rule_id), at, f"id {rule_id}")
    return rule_id


# --- inputs -----------------------------------------------------------------------------------


def _input_of(known: _Stations) -> Reader[tuple[StationConfig, InputConfig] | None]:
    return shaped(lambda place: _input(place, text(place), known), TEXT)


def _input(
    place: Place, written: str, known: _Stations
) -> tuple[StationConfig, InputConfig] | None:
    """Return the input that is written so; None: its station has a problem of its own."""
    match = _INPUT.fullmatch(written)
    if match is None:
        raise WrongValueError(f"{written!a} is no input; write one as STATION/di/N: garage/di/3")
    station = _station(place, match["station"], known)
    if station is None:
        return None
    for channel in station.inputs:
        if channel.channel == int(match["channel"]):
            return station, channel
    raise WrongValueError(f"station {station.id} has no input {match['channel']}; {_has(station)}")


def _has(station: StationConfig) -> str:
    if not station.inputs:
        return f"a {station.model.name} has none, or all are left out"
    return f"it has {', '.join(str(channel.channel) for channel in station.inputs)}"


def _station(place: Place, name: str, known: _Stations) -> StationConfig | None:
    station = known.stations.get(name)
    if station is not None:
        return station
    if not known.is_whole or place.source.shapes is not None:
        return None  # it may be one of those that could not be read
    meant = nearest(name, known.stations)
    advice = f"did you mean {meant}?" if meant else f"there are {', '.join(known.stations)}"
    raise WrongValueError(f"there is no station {name!a}; {advice}")


def _conditions_of(known: _Stations) -> Reader[tuple[InputState, ...]]:
    def read(place: Place) -> tuple[InputState, ...]:
        found = []
        for name, entry in entries(place).items():
            on = entry.value.read(choice(_STATES), None)
            at = entry.key.read(partial(_input, written=name, known=known), None)
            if on is not None and at is not None:
                found.append(InputState(at[0].id, at[1].channel, on))
        return tuple(found)

    return looking(read, lambda _: named(_INPUT_NAME, words(*_STATES)))


def _check_event(table: Table, channel: InputConfig, event: str) -> None:
    if event in _STATES:
        return
    if channel.gestures is None:
        table.problem("is", f"{event} needs gestures at that input; write gestures: true there")
    elif event == Gesture.DOUBLE and not channel.gestures.double_s:
        table.problem("is", "double presses are off at that input (double: 0s); give them a time")


def _check_possible(
    table: Table,
    when: tuple[StationConfig, InputConfig],
    event: str,
    conditions: Iterable[InputState],
) -> None:
    own = InputState(when[0].id, when[1].channel, not _STATES.get(event, False))
    if event in _STATES and own in conditions:
        table.problem("while", f"asks the input of when not to be {event}: it would never act")


# --- orders -----------------------------------------------------------------------------------


def _orders_of(known: _Stations) -> Reader[tuple[RuleOrder, ...]]:
    def read(place: Place) -> tuple[RuleOrder, ...]:
        found = list[RuleOrder]()
        listed = entries(place)
        for name, entry in listed.items():
            read_order = partial(_order, name=name, value=entry.value, known=known)
            order = entry.key.read(read_order, None)
            if order is not None:
                _check_together(entry.key, order, found, known.stations[order.station])
                found.append(order)
        if not listed:
            raise WrongValueError("orders nothing; write what to do, such as {hall/do/2: TOGGLE}")
        return tuple(found)

    return looking(read, lambda _: named(_TARGET_NAME, words(*_OUTPUT_WORDS, *_COVER_WORDS)))


def _order(key: Place, name: str, value: Place, known: _Stations) -> RuleOrder | None:
    match = _TARGET.fullmatch(name)
    if match is None:
        raise WrongValueError(
            f"{name!a} is no output and no cover; write STATION/do/N or STATION/cover/ID"
        )
    station = _station(key, match["station"], known)
    if station is None:
        return None
    kind, _, which = match["name"].partition("/")
    if kind == "cover":
        mask = _cover_outputs(station, which)
        word = value.read(choice(_COVER_WORDS), None)
    else:
        output = _output(station, int(which))
        mask = bit(output.channel)
        word = value.read(choice(_OUTPUT_WORDS), None)
        if word is not None and (objection := _objection(station, output, word)):
            value.problem(objection)
            return None
    return None if word is None else RuleOrder(station.id, match["name"], word, mask)


def _cover_outputs(station: StationConfig, name: str) -> int:
    for cover in station.covers:
        if cover.id == name:
            return cover.outputs
    raise WrongValueError(f"station {station.id} has no cover {name!a}; look at its covers")


def _output(station: StationConfig, channel: int) -> OutputConfig:
    for output in station.outputs:
        if output.channel == channel:
            return output
    there = ", ".join(str(output.channel) for output in station.outputs)
    raise WrongValueError(f"station {station.id} has no output {channel}; it has {there}")


def _objection(station: StationConfig, output: OutputConfig, word: str) -> str | None:
    """Return why this word cannot be said to that output; None: it can."""
    if output.read_only:
        return "that output is read_only; take one of the two out"
    if station.cover_outputs & bit(output.channel) and word != Word.OFF:
        return "that output drives a cover; command the cover, as STATION/cover/ID: OPEN"
    if word == Word.TOGGLE and output.mode == "pulse":
        return "a pulse goes OFF by itself and is not toggled; write PRESS"
    if word == Word.PRESS and output.mode != "pulse":
        return "PRESS is for a pulse; write mode: pulse at that output, or ON here"
    return None


def _check_together(
    key: Place, order: RuleOrder, before: Sequence[RuleOrder], station: StationConfig
) -> None:
    """Report an order that cannot stand beside an earlier one of the same rule."""
    for other in before:
        if other.station != order.station:
            continue
        if other.mask & order.mask:
            key.problem(f"names an output that {other.target} names; write one of the two")
        elif {order.word, other.word} <= {Word.ON, Word.PRESS, Word.TOGGLE}:
            both = order.mask | other.mask
            if any((group & both).bit_count() > 1 for group in station.interlock):
                these = " and ".join(map(str, channels_of(both)))
                key.problem(f"outputs {these} are interlocked: only one of them may go ON")


def _check_fight(at: Place, one: RuleConfig, other: RuleConfig) -> None:
    """Report two rules that order different things of one output at one event."""
    if one.trigger != other.trigger or _never_both(one, other):
        return
    for first in one.orders:
        for second in other.orders:
            if first.station != second.station or not first.mask & second.mask:
                continue
            same = first.target == second.target and first.word == second.word
            if same and first.word not in {Word.TOGGLE, Word.PRESS}:
                continue
            at.problem(
                f"fights with rule {one.name} for {second.station}/{second.target} at the same "
                "event; take one of the two out, or let while tell them apart"
            )
            return


def _never_both(one: RuleConfig, other: RuleConfig) -> bool:
    """Return whether an input has to read ON for one of them and OFF for the other."""
    opposite = {InputState(c.station, c.channel, not c.on) for c in one.conditions}
    return not opposite.isdisjoint(other.conditions)


_INPUT_NAME = r"^[a-z0-9_-]+/di/[1-9][0-9]?$"
_TARGET_NAME = r"^[a-z0-9_-]+/(do/[1-9][0-9]?|cover/[a-z0-9_-]+)$"
