"""Decides which rules of the configuration an event fires, and what they order.

Only what is seen live fires a rule: a change between two reads of one contact. Nothing is ordered
more than 2 s after the last read that showed the input as it was before. Time is an argument
(`bridge.clock.boot_s`).
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator

from bridge.config.schema import RuleConfig, RuleOrder
from bridge.line.rules.cover import CLOSED, OPEN
from bridge.model import AnyCommand, Command, CoverCommand, Gesture, Word, bit

PATIENCE_S = 2.0  # as for a command (docs/contract.md, promise 2)

_GOALS = {"OPEN": OPEN, "CLOSE": CLOSED, "STOP": None}


class InputRules:
    """The rules by their inputs."""

    def __init__(self, rules: Iterable[RuleConfig] = ()) -> None:
        self._by_input: dict[tuple[str, int], list[RuleConfig]] = defaultdict(list)
        for rule in rules:
            self._by_input[rule.station_id, rule.channel].append(rule)

    def changed(self, station_id: str, before: int, after: int) -> Iterator[RuleConfig]:
        """Yield the rules that a change of the inputs fires."""
        for (name, channel), rules in self._by_input.items():
            if name == station_id and (before ^ after) & bit(channel):
                event = "ON" if after & bit(channel) else "OFF"
                yield from (rule for rule in rules if rule.event == event)

    def pressed(self, station_id: str, channel: int, gesture: Gesture) -> Iterator[RuleConfig]:
        """Yield the rules that a press fires."""
        for rule in self._by_input.get((station_id, channel), ()):
            if rule.event == gesture:
                yield rule


def held(rule: RuleConfig, inputs_of: Callable[[str], int | None]) -> str | None:
    """Return why a rule orders nothing now, in words; None: nothing holds it.

    `inputs_of` returns the inputs of a station; None: they are not known now.
    """
    for wanted in rule.conditions:
        inputs, name = inputs_of(wanted.station_id), f"{wanted.station_id}/di/{wanted.channel}"
        if inputs is None:
            return f"{name} is not known: its module does not answer"
        if bool(inputs & bit(wanted.channel)) is not wanted.on:
            return f"{name} is {'OFF' if wanted.on else 'ON'}"
    return None


def commands_of(rule: RuleConfig, seen_at: float, deadline: float) -> list[AnyCommand]:
    """Return the commands of a rule whose event was seen at `seen_at`."""
    return [_command(rule, order, seen_at, deadline) for order in rule.orders]


def _command(rule: RuleConfig, order: RuleOrder, seen_at: float, deadline: float) -> AnyCommand:
    by = f"rule {rule.name}"
    if order.word in _GOALS:
        return CoverCommand(
            order.station_id,
            order.target,
            order.word,
            cover=order.target.removeprefix("cover/"),
            mask=order.mask,
            goal=_GOALS[order.word],
            arrived=seen_at,
            deadline=deadline,
            by=by,
        )
    word = Word(order.word)
    return Command(
        order.station_id,
        order.target,
        order.word,
        mask=order.mask,
        values=order.mask if word in {Word.ON, Word.PRESS} else 0,
        word=word if word in {Word.TOGGLE, Word.PRESS} else None,
        arrived=seen_at,
        deadline=deadline,
        by=by,
    )
