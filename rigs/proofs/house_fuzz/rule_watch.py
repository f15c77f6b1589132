"""What the oracle knows of local rules: which event may order what, and until when."""

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from bridge.config.schema import InputConfig, RuleConfig, RuleOrder
from bridge.model import channels_of
from bridge.mqtt.events import Received
from proofs.house_fuzz.wishes import PATIENCE_S, Wish

if TYPE_CHECKING:
    from proofs.house_fuzz.oracle import Oracle, Station

RELOAD_S = 10.0  # within so long a line ends
SURELY_OFFLINE_S = 15.0
READ_WITHIN_S = 8.0  # so old the bridge's knowledge of an input can be
ASKED_S = 30.0  # within so long the broker has what came of a switch
GAP_S = 1.0  # between two reads of a button


class RuleWatch:
    """Makes a wish of each order of an event: what went out without one was unasked."""

    def __init__(self, oracle: "Oracle", rules: Sequence[RuleConfig]) -> None:
        self._oracle = oracle
        self._until = dict.fromkeys(rules, math.inf)  # when each is not in force any more
        self._off_since: dict[str, float] = {}
        self._on_asked: dict[str, float] = {}
        self.slowest_s = 0.0

    @property
    def now(self) -> float:
        """The instant."""
        return self._oracle.clockwork.now

    def loaded(self, rules: Sequence[RuleConfig]) -> None:
        """The bridge read its file."""
        for rule, until in self._until.items():
            if rule not in rules:
                self._until[rule] = min(until, self.now + RELOAD_S)
        self._until |= dict.fromkeys(rules, math.inf)

    def arrived(self, received: Received) -> None:
        """The bridge was handed a message: it may switch a rule on."""
        match received.topic.split("/"):
            case [*_, "bridge", "rule", rule, "set"] if received.payload == b"ON":
                self._on_asked[rule] = self.now
                self._off_since.pop(rule, None)

    def told(self, rule: str, payload: bytes) -> None:
        """The broker has whether a rule is on."""
        if payload != b"OFF":
            self._off_since.pop(rule, None)
        elif self.now - self._on_asked.get(rule, -math.inf) > ASKED_S:
            self._off_since.setdefault(rule, self.now)

    def happened(self, station: "Station", channel: InputConfig, value: bool) -> None:
        """An input changed."""
        for rule, until in self._until.items():
            if until < self.now or (rule.station_id, rule.channel) != (
                station.config.id,
                channel.channel,
            ):
                continue
            slack_s = _slack_s(rule, channel, value)
            if slack_s is None:
                continue
            self._oracle.counts["rule events"] += 1
            barred = self._barred(station)
            if barred:
                self._oracle.counts[f"rule events while {barred}"] += 1
            for order in rule.orders:
                self._wish(rule, order, slack_s, barred)

    def _barred(self, station: "Station") -> str | None:
        """Return why this change is seen by no live read; None: it may be."""
        oracle = self._oracle
        if oracle.is_down:
            return "the bridge is down"
        if self.now - oracle.ports_gone.get(station.line, math.inf) > GAP_S:
            return "the port is gone"
        if station.away_since is not None and self.now - station.away_since > SURELY_OFFLINE_S:
            return "the module is offline"
        return None

    def _wish(self, rule: RuleConfig, order: RuleOrder, slack_s: float, barred: str | None) -> None:
        wish = Wish(
            order.station_id,
            order.target,
            order.word,
            None,
            self.now,
            self.now + PATIENCE_S + slack_s,
            _values(order),
            press=order.word == "PRESS",
            barred=barred and f"first read: {barred}",
            by=f"rule {rule.name}",
            held=partial(self._held, rule, self.now),
            slack_s=slack_s,
        )
        self._oracle.stations[order.station_id].wishes.append(wish)

    def _held(self, rule: RuleConfig, since: float) -> bool:
        """Tell whether a rule cannot have acted on an event of `since` by now."""
        if self._off_since.get(rule.id, math.inf) <= since:
            return True
        if rule.broker_away and self._oracle.broker_well(READ_WITHIN_S):
            return True
        return any(
            not self._oracle.read_so(
                one.station_id, one.channel, one.on, since - READ_WITHIN_S, self.now
            )
            for one in rule.conditions
        )

    def used(self, wish: Wish, at: float) -> None:
        """A frame was taken for it."""
        if wish.by is not None and not wish.uses.get(next(iter(wish.values))):
            self._oracle.counts["rule orders on the wire"] += 1
            if not wish.slack_s:
                self.slowest_s = max(self.slowest_s, at - wish.arrived)

    def find(self, station: "Station", verdict: dict[str, Any]) -> Wish | None:
        """Return the wish that a verdict is on; None: there is none."""
        arrived = self.now - int(verdict["ms"]) / 1000
        able = [
            wish
            for wish in station.wishes
            if (wish.by, wish.target, wish.payload)
            == (verdict["by"], verdict["target"], verdict["payload"])
            and wish.judged is None
            and wish.barred is None
        ]
        return min(able, key=lambda w: abs(w.arrived - arrived), default=None)


def _slack_s(rule: RuleConfig, channel: InputConfig, value: bool) -> float | None:
    """Return how long an event may take to be decided; None: this is none of its rule."""
    if rule.event in {"ON", "OFF"}:
        return 0.0 if value is (rule.event == "ON") else None
    gestures = channel.gestures
    if gestures is None or value is (rule.event == "short"):
        return None
    lasts_s = {"short": gestures.double_s, "long": gestures.long_s, "double": 0.0}
    return lasts_s[rule.event] + GAP_S


def _values(order: RuleOrder) -> dict[int, bool | None]:
    if order.target.startswith("cover"):
        return {} if order.word == "STOP" else dict.fromkeys(channels_of(order.mask), True)
    (output,) = channels_of(order.mask)
    return {output: None if order.word == "TOGGLE" else order.word != "OFF"}
