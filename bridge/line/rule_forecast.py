"""How soon a local rule acts, computed before anything is sent."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from bridge.config.schema import Config, LineConfig, RuleConfig, RuleOrder, StationConfig
from bridge.line.forecast import Forecast
from bridge.line.rules.local_rules import PATIENCE_S
from bridge.model import Gesture, LineProtocol, Word


@dataclass(frozen=True, slots=True)
class RuleForecast:
    """Times in seconds, while every module answers and no command comes.

    Attributes:
        lasts_s: How long the event lasts until it is decided: debounce, a long press, the time in
            which a second press may follow.
        answer_s: From then on, at most, until the last of its orders is on the wire.
    """

    lasts_s: float
    answer_s: float


def rule_forecast(rule: RuleConfig, config: Config, plans: Mapping[str, Forecast]) -> RuleForecast:
    """Return the times of one rule; `plans` are those of the lines."""
    places = {
        station_config.id: (line, station_config) for line, station_config in config.all_stations
    }
    line, station_config = places[rule.station_id]
    answer_s = plans[line.id].inputs_s[rule.station_id]
    if line.protocol is LineProtocol.WISCO:
        answer_s += plans[line.id].exchange_s  # a change is read twice
    lines = [places[order.station_id][0].id for order in rule.orders]
    if set(lines) != {line.id}:
        answer_s += max(plans[one].exchange_s for one in lines)  # the one that is under way there
    for number, order in enumerate(rule.orders):
        plan = plans[lines[number]]
        answer_s += _before_s(order, *places[order.station_id], plan) + plan.exchange_s
        if number + 1 < len(rule.orders):
            answer_s += plan.exchange_s  # the read after the write
    return RuleForecast(_lasts_s(rule, station_config), answer_s)


def _before_s(order: RuleOrder, line: LineConfig, config: StationConfig, plan: Forecast) -> float:
    """Return the time of the reads that come before a write."""
    if order.word == Word.PRESS:
        return plan.settings_s
    locked = any(group & order.mask for group in config.interlock)
    if order.word == Word.TOGGLE or (locked and order.word not in {Word.OFF, "STOP"}):
        return plan.exchange_s * (1 if line.asks_modbus(config) else 2)
    return 0.0


def _lasts_s(rule: RuleConfig, config: StationConfig) -> float:
    channel = next(one for one in config.inputs if one.channel == rule.channel)
    lasts_s = channel.debounce_s
    if channel.gestures is not None:
        if rule.event == Gesture.SHORT:
            lasts_s += channel.gestures.double_s
        elif rule.event == Gesture.LONG:
            lasts_s += channel.gestures.long_s
    return lasts_s


def rules_too_slow(config: Config, plans: Mapping[str, Forecast]) -> Iterator[str]:
    """Yield one line for each rule whose input is read too seldom."""
    for rule in config.rules:
        answer_s = rule_forecast(rule, config, plans).answer_s
        if answer_s > PATIENCE_S:
            yield (
                f"rule {rule.name}: its orders may go out {answer_s:.1f} s after a change, "
                f"and what is over {PATIENCE_S:g} s late is not sent; give the station of "
                f"{rule.station_id}/di/{rule.channel} priority: high, or its line fewer stations"
            )
