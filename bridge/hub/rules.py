"""The rules of the house in the main thread: those across lines, and which are switched on."""

from collections.abc import Callable, Mapping

from bridge.config.current import CurrentConfig
from bridge.config.schema import RuleConfig
from bridge.hub.line_set import Worker
from bridge.hub.memory import Memory
from bridge.line.rules.local_rules import commands_of, held
from bridge.model import (
    AnyCommand,
    Publish,
    RuleDue,
    RuleFired,
    RuleSwitched,
    StateEvent,
    StationChanged,
    ValuesChanged,
)


class HouseRules:
    """Only the main thread uses it.

    A rule with all its parts on one line is carried out by that line. `submit` takes the commands
    of the others.
    """

    def __init__(
        self,
        current: CurrentConfig,
        publish: Publish,
        lines: Mapping[str, Worker],
        submit: Callable[[AnyCommand], None],
        memory: Memory,
    ) -> None:
        self._current = current
        self._publish = publish
        self._lines = lines
        self._submit = submit
        self._memory = memory
        self._online: set[str] = set()
        self._inputs: dict[str, int] = {}

    def tell_all(self) -> None:
        """Tell every line its rules, and publish which are switched on.

        Call it after lines were started, and when the configuration was replaced.
        """
        for rule in self._current.config.rules:
            self._publish(RuleSwitched(rule.id, rule.id not in self._memory.rules_off))
        for line in self._lines:
            self._tell_line(line)

    def switch(self, rule_id: str, *, on: bool) -> bool:
        """Switch a rule on or off; return whether there is such a rule."""
        rule = next((rule for rule in self._current.config.rules if rule.id == rule_id), None)
        if rule is None:
            return False
        off = self._memory.rules_off
        self._memory.rules_off = off - {rule_id} if on else off | {rule_id}
        self._publish(RuleSwitched(rule_id, on))
        self._tell_line(self._current.line_of[rule.station_id])
        return True

    def note(self, event: StateEvent) -> None:
        """Keep what inputs read: the conditions of rules look at it."""
        match event:
            case StationChanged(station_id, online):
                (self._online.add if online else self._online.discard)(station_id)
            case ValuesChanged(station_id, inputs):
                self._inputs[station_id] = inputs

    def due(self, event: RuleDue) -> None:
        """Carry out a rule with parts on several lines."""
        rule = next((rule for rule in self._active if rule.id == event.rule), None)
        if rule is None or rule.trigger != event.trigger:
            return  # it was switched off or changed meanwhile
        why_not = held(rule, self._inputs_of)
        self._publish(RuleFired(rule.id, why_not))
        if why_not is None:
            for command in commands_of(rule, event.seen_at, event.deadline):
                self._submit(command)

    @property
    def _active(self) -> list[RuleConfig]:
        off = self._memory.rules_off
        return [rule for rule in self._current.config.rules if rule.id not in off]

    def _tell_line(self, line: str) -> None:
        worker = self._lines.get(line)
        if worker is not None:  # else it is being replaced
            line_of = self._current.line_of
            worker.rules([rule for rule in self._active if line_of[rule.station_id] == line])

    def _inputs_of(self, station_id: str) -> int | None:
        return self._inputs.get(station_id) if station_id in self._online else None
