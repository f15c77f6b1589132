"""Local rules for tests, written shortly: `rule("s1/di/3", "ON", {"s1/do/2": "ON"})`."""

from collections.abc import Mapping

from bridge.config.schema import InputState, RuleConfig, RuleOrder
from bridge.model import bit


def rule(
    when: str,
    event: str,
    then: Mapping[str, str],
    *,
    conditions: Mapping[str, str] | None = None,
    broker_away: bool = False,
    name: str = "Stairs",
    covers: Mapping[str, int] | None = None,
) -> RuleConfig:
    """Return a rule; `covers` are the outputs of each cover that it commands, as bits."""
    station_id, _, channel = when.split("/")
    return RuleConfig(
        name.lower(),
        name,
        station_id,
        int(channel),
        event,
        tuple(_order(target, word, covers or {}) for target, word in then.items()),
        tuple(_state(name, word) for name, word in (conditions or {}).items()),
        broker_away,
    )


def _order(written: str, word: str, covers: Mapping[str, int]) -> RuleOrder:
    station_id, kind, which = written.split("/")
    mask = covers[which] if kind == "cover" else bit(int(which))
    return RuleOrder(station_id, f"{kind}/{which}", word, mask)


def _state(written: str, word: str) -> InputState:
    station_id, _, channel = written.split("/")
    return InputState(station_id, int(channel), word == "ON")
