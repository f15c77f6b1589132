"""Houses whose inputs switch their outputs by local rules, on the clockwork."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from support.rules import rule

from bridge.config.schema import (
    Config,
    GestureConfig,
    HomeAssistantConfig,
    InputConfig,
    LineConfig,
    MqttConfig,
    OutputConfig,
    RuleConfig,
    StationConfig,
)
from bridge.line.forecast import forecast
from bridge.model import DIO100, LineProtocol
from bridge.simulator.faults import is_write
from proofs.house_fuzz.broker import BASE, STATUS
from proofs.house_fuzz.house import House
from proofs.house_fuzz.steps import Steps, with_calm

STEPS_A_HOUSE = 2500
CALM_S = 50.0
MET_S = 6.0
PULSE = 8
# Inputs change all the time, no command arrives, and everything goes wrong now and then.
TROUBLES = {
    "command": 0.0,
    "feed": 45.0,
    "mode": 0.0,
    "retained": 0.0,
    "faults": 2.0,
    "cut": 0.5,
    "broker_stops": 0.3,
    "reload": 0.4,
    "suspend": 0.15,
    "restart": 0.1,
    "rule_switch": 0.2,
    "module_away": 0.3,
    "port_away": 0.2,
}

RULES = (
    rule("a1/di/1", "ON", {"a1/do/1": "TOGGLE"}, name="Toggle"),
    rule("a1/di/2", "ON", {"a2/do/8": "PRESS"}, name="Bell"),
    rule("a1/di/3", "ON", {"a2/do/3": "ON", "a2/do/4": "OFF"}, name="Scene"),
    rule("a1/di/3", "OFF", {"a2/do/3": "OFF", "a2/do/4": "ON"}, name="Scene-off"),
    rule("a2/di/7", "short", {"a1/do/5": "TOGGLE"}, name="Button"),
    rule("a2/di/1", "ON", {"b1/do/1": "TOGGLE"}, name="Across"),
    rule("b1/di/2", "OFF", {"a1/do/8": "PRESS"}, name="Across-bell"),
    rule("b1/di/3", "ON", {"b1/do/6": "ON"}, conditions={"a2/di/9": "OFF"}, name="Held"),
    rule("b1/di/4", "ON", {"b1/do/7": "TOGGLE"}, broker_away=True, name="Away"),
)


@dataclass(slots=True)
class Told:
    """What came of the events.

    Attributes:
        slowest_s: The longest time from a change to its frame.
        broken: What is not as promised.
    """

    counts: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    broken: list[str] = field(default_factory=list)

    @property
    def events(self) -> int:
        """How many changes could fire a rule, were they seen live."""
        return self.counts["rule events"]

    @property
    def unseen(self) -> int:
        """How many of them nobody can have seen live."""
        return sum(n for name, n in self.counts.items() if name.startswith("rule events while"))


def troubled(way: str, events: int, seed: int = 1) -> Told:
    """Let inputs change in houses where everything goes wrong."""
    told = Told()
    while told.events < events and not told.broken:
        house = House(way, seed, _config(_lines(way), RULES))
        with house.in_place():
            house.start()
            house.settle(MET_S)
            steps, enough = Steps(house, TROUBLES), events - told.events
            for _ in range(STEPS_A_HOUSE):
                steps.one()
                if house.oracle.broken or house.oracle.counts["rule events"] >= enough:
                    break
            with_calm(house)
            house.settle(CALM_S)
            house.oracle.watch()
            house.oracle.judge_calm()
            house.stop()
        told.counts += house.oracle.counts
        told.slowest_s = max(told.slowest_s, house.oracle.rules.slowest_s)
        told.broken += [f"{way} seed {seed}: {one}" for one in house.oracle.broken]
        told.broken += house.clockwork.errors
        seed += 1
    return told


@dataclass(frozen=True, slots=True)
class Answers:
    """How long presses took to the wire, and how long they may."""

    took_s: list[float]
    bound_s: float


def answered(
    way: str, baud: int, stations: int, presses: int, *, across: bool, broker: bool
) -> Answers:
    """Press one input of a line again and again, each time at another moment of the round."""
    lines = [_plain_line(name, way, baud, stations) for name in ("ab" if across else "a")]
    target = f"{lines[-1].id}{stations}/do/2"
    rules = [rule("a1/di/1", word, {target: word}, name=word) for word in ("ON", "OFF")]
    house = House(way, 1, _config(lines, rules), by_bytes=True)
    took_s = []
    with house.in_place():
        if not broker:
            house.broker.listens = False
        house.start()
        house.settle(MET_S + 0.2 * stations)
        wire = house.lines[lines[-1].port].wire
        for _ in range(presses):
            pressed_at = house.clockwork.now
            house.oracle.feed(house.oracle.stations["a1"], 1)
            while not (sent := [at for at, f in wire if at >= pressed_at and is_write(f)]):
                assert house.clockwork.now < pressed_at + 5.0, "a press came to nothing"
                house.settle(0.02)
            took_s.append(sent[0] - pressed_at)
            house.settle(house.chance.uniform(0.3, 1.0))
        house.stop()
    assert not house.oracle.broken, house.oracle.broken[0]
    plan = forecast(lines[0])
    return Answers(took_s, plan.inputs_s["a1"] + 2 * plan.exchange_s)


def _config(lines: Iterable[LineConfig], rules: Iterable[RuleConfig]) -> Config:
    return Config(
        MqttConfig("broker", 1883, BASE, "client", "auto"),
        HomeAssistantConfig("off", "homeassistant", STATUS),
        Path("/nowhere"),
        tuple(lines),
        tuple(rules),
    )


def _lines(way: str) -> list[LineConfig]:
    protocol = LineProtocol(way.removesuffix("-only"))
    first = LineConfig("a", "/dev/a", 19200, protocol, (_station("a", 1), _station("a", 2)))
    return [first, LineConfig("b", "/dev/b", 9600, protocol, (_station("b", 1),))]


def _plain_line(name: str, way: str, baud: int, stations: int) -> LineConfig:
    numbers = range(1, stations + 1)
    return LineConfig(
        name,
        f"/dev/{name}",
        baud,
        LineProtocol(way),
        tuple(_station(name, number) for number in numbers),
    )


def _station(line: str, address: int) -> StationConfig:
    button = GestureConfig(double_s=0.0)
    inputs = tuple(InputConfig(n, gestures=button if n == 7 else None) for n in range(1, 17))
    outputs = tuple(OutputConfig(n, mode="pulse" if n == PULSE else None) for n in range(1, 9))
    name = f"{line}{address}"
    return StationConfig(address, DIO100, name, name, inputs, outputs)
