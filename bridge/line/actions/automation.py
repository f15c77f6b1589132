"""Carries out the rules of inputs of a line: their orders wait in the inbox as commands do."""

from collections.abc import Callable, Iterable, Mapping

from bridge.config.schema import RuleConfig
from bridge.line.rules.local_rules import PATIENCE_S, InputRules, commands_of, held
from bridge.line.station import Station
from bridge.model import AnyCommand, Gesture, LineEvent, RuleDue, RuleFired


class Automation:
    """The rules whose input is on one line. Only its thread uses it.

    One with all its parts on this line is carried out here; the event of another one goes to the
    main thread.
    """

    def __init__(
        self,
        stations: Mapping[str, Station],
        submit: Callable[[AnyCommand], None],
        emit: Callable[[LineEvent], None],
        clock: Callable[[], float],
    ) -> None:
        self._stations = stations
        self._submit = submit
        self._emit = emit
        self._clock = clock
        self._rules = InputRules()
        self._is_away = False

    def replace(self, rules: Iterable[RuleConfig]) -> None:
        """Use these rules from now on: those that are switched on."""
        self._rules = InputRules(rules)

    def broker(self, away_since: float | None) -> None:
        """Use whether the broker is away."""
        self._is_away = away_since is not None

    def changed(self, station: Station, before: int | None, unchanged_at: float) -> None:
        """Fire the rules of a change that was read just now; the first value is no change.

        `unchanged_at` is when the inputs were last read as before.
        """
        after = station.inputs.value
        if before is not None and after is not None:
            rules = self._rules.changed(station.config.id, before, after)
            self._fire(rules, unchanged_at + PATIENCE_S)

    def pressed(
        self, station: Station, made: Iterable[tuple[int, Gesture]], unchanged_at: float
    ) -> None:
        """Fire the rules of presses that the read just now completed."""
        for channel, gesture in made:
            rules = self._rules.pressed(station.config.id, channel, gesture)
            self._fire(rules, unchanged_at + PATIENCE_S)

    def _fire(self, rules: Iterable[RuleConfig], deadline: float) -> None:
        now = self._clock()
        if now > deadline:
            return  # it may have happened long ago: the inputs were not read meanwhile
        for rule in rules:
            if rule.broker_away and not self._is_away:
                continue
            if rule.station_ids <= self._stations.keys():
                self._carry_out(rule, now, deadline)
            else:
                self._emit(RuleDue(rule.id, rule.trigger, now, deadline))

    def _carry_out(self, rule: RuleConfig, now: float, deadline: float) -> None:
        why_not = held(rule, self._inputs_of)
        self._emit(RuleFired(rule.id, why_not))
        if why_not is None:
            for command in commands_of(rule, now, deadline):
                self._submit(command)

    def _inputs_of(self, name: str) -> int | None:
        station = self._stations[name]
        answers = station.presence.online and station.presence.suspect is None
        return station.inputs.value if answers else None
