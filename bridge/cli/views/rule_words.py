"""Local rules in words, for `check`."""

from bridge.config.schema import RuleConfig
from bridge.line.rule_forecast import RuleForecast

_EVENTS = {
    "ON": ("when {} goes ON", "of that"),
    "OFF": ("when {} goes OFF", "of that"),
    "short": ("at a short press of {}", "of its release"),
    "long": ("at a long press of {}", "of its begin"),
    "double": ("at a double press of {}", "of the second one"),
}


def in_words(rule: RuleConfig, forecast: RuleForecast) -> str:
    """Return what a rule does, and within which time."""
    told, begin = _EVENTS[rule.event]
    when = told.format(f"{rule.station_id}/di/{rule.channel}")
    orders = ", ".join(f"{one.station_id}/{one.target} {one.word}" for one in rule.orders)
    conditions = "".join(
        f", while {one.station_id}/di/{one.channel} is {'ON' if one.on else 'OFF'}"
        for one in rule.conditions
    )
    only = ", only while the broker is away" if rule.broker_away else ""
    within_ms = (forecast.lasts_s + forecast.answer_s) * 1000
    return f"{when}: {orders}{conditions}{only}; answered within {within_ms:.0f} ms {begin}"
