"""The section `rules`: what inputs do to outputs inside the bridge."""

from collections.abc import Iterable
from itertools import combinations

from bridge.config.names import folded, id_from, identifier
from bridge.config.nodes import Place, Reader, items
from bridge.config.rule_parts import STATES, Stations, conditions_of, input_of, orders_of
from bridge.config.scalars import choice
from bridge.config.schema import InputConfig, InputState, LineConfig, RuleConfig, StationConfig
from bridge.config.tables import Table, Unique, table_of
from bridge.config.text import label
from bridge.model import Gesture, Word

_EVENTS = {word: word for word in (*STATES, *Gesture)}
_ONLY = {"always": False, "broker_away": True}


def rules_of(lines: Iterable[LineConfig]) -> Reader[tuple[RuleConfig, ...]]:
    """Return a reader of `rules` over the stations of these lines."""
    stations = {config.id: config for line in lines for config in line.stations}

    def read(place: Place) -> tuple[RuleConfig, ...]:
        known = Stations(stations, is_whole=not place.source.problems)
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


def _read_rule(place: Place, known: Stations, names: Unique, ids: Unique) -> RuleConfig | None:
    with table_of(place) as table:
        name = table.need("name", label, "write one that verdicts and Home Assistant show")
        rule_id = _read_id(table, name, ids)
        if name is not None:
            names.claim(name, table.place("name"), f"name {name}")
        when = table.need("when", input_of(known), "write an input, such as garage/di/3")
        event = table.need("is", choice(_EVENTS), f"write one of {', '.join(_EVENTS)}")
        orders = table.need("then", orders_of(known), "write what to do, as {hall/do/2: ON}")
        conditions = table.get("while", conditions_of(known), ())
        broker_away = table.get("only", choice(_ONLY), False)
        if when is not None and event is not None:
            _check_event(table, when[1], event)
            _check_possible(table, when, event, conditions)
    if name is None or rule_id is None or when is None or event is None or not orders:
        return None
    config, channel = when
    return RuleConfig(
        rule_id, name, config.id, channel.channel, event, orders, conditions, broker_away
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


def _check_event(table: Table, channel: InputConfig, event: str) -> None:
    if event in STATES:
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
    own = InputState(when[0].id, when[1].channel, not STATES.get(event, False))
    if event in STATES and own in conditions:
        table.problem("while", f"asks the input of when not to be {event}: it would never act")


def _check_fight(at: Place, one: RuleConfig, other: RuleConfig) -> None:
    """Report two rules that order different things of one output at one event."""
    if one.trigger != other.trigger or _never_both(one, other):
        return
    for first in one.orders:
        for second in other.orders:
            if first.station_id != second.station_id or not first.mask & second.mask:
                continue
            same = first.target == second.target and first.word == second.word
            if same and first.word not in {Word.TOGGLE, Word.PRESS}:
                continue
            at.problem(
                f"fights with rule {one.name} for {second.station_id}/{second.target} at the same "
                "event; take one of the two out, or let while tell them apart"
            )
            return


def _never_both(one: RuleConfig, other: RuleConfig) -> bool:
    """Return whether an input has to read ON for one of them and OFF for the other."""
    opposite = {InputState(c.station_id, c.channel, not c.on) for c in one.conditions}
    return not opposite.isdisjoint(other.conditions)
