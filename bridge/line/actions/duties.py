"""The writes of `max_on` and `on_loss`, which switch outputs without a command."""

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Protocol

from bridge.config.schema import StationConfig
from bridge.line.actions.sending import READ_TRIES
from bridge.line.actions.switching import OrderLostError, Switcher
from bridge.line.exchanger import Exchanger
from bridge.line.report import LineReport
from bridge.line.rules.max_on import MaxOn
from bridge.line.rules.on_loss import OnLoss
from bridge.line.station import Station
from bridge.model import Command, Orders, Reason, Status, Verdict, bit, verdict_on

# as for a command (docs/contract.md, promise 2): after this time it is not sent
PATIENCE_S = 2.0


class Rule(Protocol):
    """A rule that switches one output without a command."""

    output: int
    on: bool

    @property
    def cause(self) -> str:
        """Return its key in the configuration."""

    @property
    def why(self) -> str:
        """Return the reason of the order, in words."""

    @property
    def failing(self) -> bool:
        """Return whether the last order failed."""

    def seen(self, on: bool, now: float) -> None:
        """Use the value of the output that was read."""

    def broker(self, away_since: float | None) -> None:
        """Use that the broker went away, or came back (None)."""

    def is_due(self, now: float) -> bool:
        """Return whether the output has to be switched now."""

    def tried(self, *, over: bool, now: float) -> None:
        """Record that it was ordered; `over`: it worked, or may not be ordered again."""


class Duties:
    """Makes one due write at a time. Only the thread of the line uses it.

    Such an order is a write like any other, under the same rules (`actions.writes`). After a
    failure it is ordered again, after a pause. An order that may have started a pulse is never
    repeated (docs/contract.md, promise 1).
    """

    def __init__(
        self,
        stations: Iterable[Station],
        switcher: Switcher,
        report: LineReport,
        clock: Callable[[], float],
        unread: Container[str] = (),
    ) -> None:
        """Args: `unread` are the stations of which a write waits to be read back."""
        self._switcher = switcher
        self._unread = unread
        self._report = report
        self._clock = clock
        with_rules = ((station, list(_rules(station.config))) for station in stations)
        self._rules: Sequence[tuple[Station, list[Rule]]] = [x for x in with_rules if x[1]]
        self._seen: dict[str, int | None] = {}
        self._away_since: float | None = None

    def __bool__(self) -> bool:
        return bool(self._rules)

    def broker(self, away_since: float | None, done: Orders = frozenset()) -> None:
        """Use since when the broker is away (None: present), and the orders done since then."""
        if away_since == self._away_since:
            return
        self._away_since = away_since
        for station, rules in self._rules:
            for rule in rules:
                was_made = (station.config.id, rule.output) in done
                rule.broker(None if was_made else away_since)

    def work(self, bus: Exchanger) -> None:
        """Make one write if one is due; reads come before the next one. Raises PortError."""
        for station, rules in self._rules:
            self._observe(station, rules)
        for station, rules in self._rules:
            if station.presence.suspect is not None or not station.listens:
                continue
            if station.config.id in self._unread:
                continue  # else what is ordered here would be taken for a write that was lost
            now = self._clock()
            rule = next((rule for rule in rules if rule.is_due(now)), None)
            if rule is not None:
                try:
                    self._order(rule, station, bus)
                finally:
                    self._observe(station, rules)
                return

    def overdue(self) -> list[Station]:
        """Return the absent modules with a due order."""
        now = self._clock()
        return [
            station
            for station, rules in self._rules
            if not station.presence.online and any(rule.is_due(now) for rule in rules)
        ]

    def _observe(self, station: Station, rules: Iterable[Rule]) -> None:
        outputs = station.outputs.value
        if outputs == self._seen.get(station.config.id):
            return
        self._seen[station.config.id] = outputs
        if outputs is not None:  # None: the module is away
            now = self._clock()
            for rule in rules:
                rule.seen(bool(outputs & bit(rule.output)), now)

    def _order(self, rule: Rule, station: Station, bus: Exchanger) -> None:
        command = _command(rule, station, self._clock())
        if command.values and station.tells_settings and not self._are_modes_known(station, bus):
            rule.tried(over=False, now=self._clock())
            return
        maybe_pulse = station.maybe_pulse & command.values
        if station.known_pulse & command.values:
            self._ordered(rule, station, self._would_not_stay(command), once=True)
            return
        try:
            verdict = self._switcher.switch(command, station, bus)
        except OrderLostError as lost:
            self._ordered(
                rule, station, lost.verdict, once=bool(maybe_pulse) and self._switcher.sent
            )
            raise
        self._ordered(rule, station, verdict, once=bool(maybe_pulse) and self._switcher.sent)

    def _ordered(self, rule: Rule, station: Station, verdict: Verdict, *, once: bool) -> None:
        over, failing = verdict.status is Status.DONE or once, rule.failing
        rule.tried(over=over, now=self._clock())
        if over and verdict.status is not Status.REFUSED and isinstance(rule, OnLoss):
            self._report.loss_order(station, rule.output)
        if over or not failing:
            detail = "; ".join(filter(None, (rule.why, verdict.detail)))
            self._report.own_order(station, replace(verdict, by=rule.cause, detail=detail))

    def _are_modes_known(self, station: Station, bus: Exchanger) -> bool:
        """Read the modes before an ON: a latch may have become a pulse (docs/failures.md F4)."""
        before = station.settings
        known = station.read_settings(bus, READ_TRIES)
        if station.settings != before:
            self._report.settings(station)
        return known or not station.tells_settings

    def _would_not_stay(self, command: Command) -> Verdict:
        return verdict_on(
            command,
            self._clock(),
            Status.REFUSED,
            Reason.BAD_PAYLOAD,
            detail="the module has this output in pulse mode, where it would not stay ON",
        )


def _command(rule: Rule, station: Station, now: float) -> Command:
    mask = bit(rule.output)
    return Command(
        station_id=station.config.id,
        target=f"do/{rule.output}",
        payload="ON" if rule.on else "OFF",
        mask=mask,
        values=mask if rule.on else 0,
        word=None,
        arrived=now,
        deadline=now + PATIENCE_S,
    )


def _rules(config: StationConfig) -> Iterator[Rule]:
    for output in config.outputs:
        if output.max_on_s is not None:
            yield MaxOn(output.channel, output.max_on_s)
        if output.on_loss is not None:
            yield OnLoss(output.channel, output.on_loss.after_s, on=output.on_loss.on)
