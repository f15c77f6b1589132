"""The random actions in a house, one after the other."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from bridge.config.schema import RuleConfig
from bridge.daemon.app import Wanted
from proofs.house_fuzz.broker import BASE
from proofs.house_fuzz.house import House
from proofs.house_fuzz.oracle import Station
from proofs.house_fuzz.plan import changed

PLAIN_PAUSE_S = 130.0
RULES_SHARE = 0.6  # of changes of inputs: those of rules


class Steps:
    """Does them. Each trouble ends by itself.

    `instead` gives other weights to some, by their names.
    """

    def __init__(self, house: House, instead: Mapping[str, float] | None = None) -> None:
        self._house = house
        self._chance = house.chance
        self._marks = 0
        self._plain: dict[tuple[str, bytes], float] = {}
        self._rules = house.config.rules
        self._stations = list(house.oracle.stations.values())
        self._actions: list[tuple[float, Callable[[], None]]] = [
            (40, self._command),
            (8, self._hand),
            (16, self._feed),
            (1, self._mode),
            (1.5, self._faults),
            (0.6, self._module_away),
            (0.4, self._port_away),
            (0.25, self._cut),
            (0.25, self._stall),
            (0.12, self._broker_stops),
            (0.12, self._mute),
            (0.1, self._slow),
            (0.15, self._retained),
            (0.5, self._rule_switch),
            (0.2, self._reload),
            (0.06, self._suspend),
            (0.05, self._restart),
            (10, lambda: None),
        ]
        other = {f"_{name}": weight for name, weight in (instead or {}).items()}
        self._weights = [other.get(action.__name__, weight) for weight, action in self._actions]
        self.calm = False

    def one(self) -> None:
        """Do one, and let a while pass."""
        chance, house = self._chance, self._house
        chance.choices(self._actions, self._weights)[0][1]()
        if chance.random() < 0.5:
            house.settle(chance.expovariate(1 / 0.15))
        elif chance.random() < 0.02:
            house.settle(chance.uniform(1.0, 12.0))
        house.oracle.watch()

    def _station(self) -> Station:
        return self._chance.choice(self._stations)

    def _later(self, seconds: float, action: Callable[[], None]) -> None:
        self._house.clockwork.after(seconds, action)

    # --- commands -----------------------------------------------------------------------------

    def _command(self) -> None:
        for _ in range(self._chance.choice((1, 1, 1, 2, 4))):
            topic, payload = self._draw_command()
            if not self._can_be_told(topic, payload):
                continue
            self._house.broker.publish(topic, payload)
            if payload.startswith(b"{") and self._chance.random() < 0.02:
                self._house.broker.publish(topic, payload)  # QoS 1: it may come twice

    def _can_be_told(self, topic: str, payload: bytes) -> bool:
        """Tell whether a verdict on it is on no other: the same without an id waits."""
        now, key = self._house.clockwork.now, (topic, payload)
        if payload.startswith(b"{"):
            return True
        before, self._plain[key] = self._plain.get(key, 0.0), now
        return now - before > PLAIN_PAUSE_S

    def _draw_command(self) -> tuple[str, bytes]:
        chance, station = self._chance, self._station()
        name = station.config.id
        kind = chance.random()
        if station.config.covers and kind < 0.15:
            if chance.random() < 0.2:
                topic, wish = (
                    f"{BASE}/{name}/cover/blind/position/set",
                    {"position": chance.randint(0, 100)},
                )
                return topic, self._text(wish, "position")
            word = chance.choice(("OPEN", "CLOSE", "STOP"))
            return f"{BASE}/{name}/cover/blind/set", self._text({"state": word}, "state")
        if kind < 0.3:
            several = chance.sample(list(station.history), chance.randint(2, 4))
            do = {str(n): chance.choice(("ON", "OFF")) for n in several}
            return f"{BASE}/{name}/set", self._text({"do": do}, None)
        output = chance.choice(list(station.history))
        if kind < 0.32:
            return f"{BASE}/{name}/do/{output}/mode/set", self._text({"mode": "latch"}, "mode")
        pulse = next(o for o in station.config.outputs if o.channel == output).mode == "pulse"
        words = (
            ("ON", "PRESS", "PRESS", "OFF")
            if pulse
            else ("ON", "OFF", "ON", "OFF", "TOGGLE", "PRESS")
        )
        word = chance.choice(words)
        return f"{BASE}/{name}/do/{output}/set", self._text({"state": word}, "state")

    def _text(self, wish: dict[str, Any], plain: str | None) -> bytes:
        chance = self._chance
        if plain is not None and chance.random() < 0.2:
            return str(wish[plain]).encode()
        self._marks += 1
        wish["id"] = f"m{self._marks}"
        if chance.random() < 0.2:
            wish["deadline"] = round(chance.uniform(0.1, 4.0), 2)
        return json.dumps(wish).encode()

    def _retained(self) -> None:
        topic, payload = self._draw_command()
        if self._can_be_told(topic, payload):
            self._house.broker.publish(topic, payload, retain=True)

    # --- at the modules -----------------------------------------------------------------------

    def _hand(self) -> None:
        station = self._station()
        output = self._chance.choice(list(station.history))
        self._house.oracle.hand(station, output, self._chance.random() < 0.5)

    def _feed(self) -> None:
        station = self._station()
        rules, chance = self._house.config.rules, self._chance
        if rules and chance.random() < RULES_SHARE:
            rule = chance.choice(rules)
            place = chance.choice([(rule.station_id, rule.channel), *_conditions(rule)])
            self._house.oracle.feed(self._house.oracle.stations[place[0]], place[1])
        elif station.inputs:
            self._house.oracle.feed(station, chance.choice(list(station.inputs)))

    def _rule_switch(self) -> None:
        """Switch a rule off or on."""
        rules = self._house.config.rules
        if rules:
            topic = f"{BASE}/bridge/rule/{self._chance.choice(rules).id}/set"
            self._house.broker.publish(topic, self._chance.choice((b"ON", b"ON", b"OFF")))

    def _mode(self) -> None:
        station, chance = self._station(), self._chance
        if station.module.wisco_only:
            return  # it cannot be asked for its modes
        output = chance.choice(list(station.history))
        if station.covers >> (output - 1) & 1:
            return
        hold_s = chance.choice((0.1, 0.5, 2.0))
        self._house.oracle.mode(station, output, pulse=chance.random() < 0.5, hold_s=hold_s)

    def _module_away(self) -> None:
        oracle, station = self._house.oracle, self._station()
        if station.away_since is not None:
            return
        oracle.away(station, away=True)
        long = self._chance.choice((0.3, 1.0, 3.0, 10.0, 60.0))
        self._later(self._chance.uniform(0.5, 1.5) * long, lambda: oracle.away(station, away=False))

    # --- at the lines -------------------------------------------------------------------------

    def _faults(self) -> None:
        house = self._house
        name, line = self._chance.choice(list(house.oracle.lines.items()))
        if line.open_error is not None:
            return
        line.set_rate(self._chance.choice((0.02, 0.1, 0.3, 0.8)))
        house.oracle.trouble(name)

        def over() -> None:
            line.set_rate(0.0)
            house.oracle.trouble(name)

        self._later(self._chance.uniform(0.1, 3.0), over)

    def _port_away(self) -> None:
        house = self._house
        name, line = self._chance.choice(list(house.oracle.lines.items()))
        if line.open_error is not None:
            return
        line.open_error = "no such device"
        house.oracle.ports_gone[name] = house.clockwork.now
        line.hang_up()

        def back() -> None:
            line.open_error = None
            house.oracle.ports_gone.pop(name, None)
            house.oracle.trouble(name)
            house.oracle.restarted(name)

        self._later(self._chance.choice((0.2, 1.0, 5.0, 20.0)), back)

    # --- at the broker ------------------------------------------------------------------------

    def _trouble(self, seconds: float, over: Callable[[], None]) -> None:
        house = self._house
        house.oracle.broker_trouble()

        def ended() -> None:
            over()
            house.oracle.broker_trouble()

        self._later(seconds, ended)

    def _cut(self) -> None:
        broker = self._house.broker
        broker.protocol = self._chance.choice(("5", "5", "3.1.1"))
        broker.forgetful = self._chance.random() < 0.3
        broker.cut()

    def _stall(self) -> None:
        seconds = self._chance.choice((0.5, 2.0, 4.0, 12.0))
        broker = self._house.broker
        broker.stalled_until = self._house.clockwork.awake_s + seconds
        self._trouble(seconds, lambda: None)

    def _broker_stops(self) -> None:
        broker = self._house.broker
        broker.listens = False
        broker.cut()
        if self._chance.random() < 0.5:
            broker.retained.clear()

        def back() -> None:
            broker.listens = True

        self._trouble(self._chance.choice((1.0, 8.0, 30.0)), back)

    def _mute(self) -> None:
        broker = self._house.broker
        broker.mute = True

        def back() -> None:
            broker.mute = False

        self._trouble(self._chance.choice((1.0, 8.0, 20.0)), back)

    def _slow(self) -> None:
        broker = self._house.broker
        broker.latency_s = self._chance.choice((0.002, 0.06, 0.3))

    # --- at the machine -----------------------------------------------------------------------

    def _reload(self) -> None:
        house = self._house
        if not house.runs:
            return
        kinds = ("same", "line", "line", "mqtt", "discovery", "rules", "nonsense")
        what = self._chance.choice(kinds)
        before = house.file or house.config
        house.file = None if what == "nonsense" else changed(before, what, self._chance)
        if what == "rules":
            kept = tuple(rule for rule in self._rules if self._chance.random() < 0.7)
            house.file = replace(before, rules=kept)
        if house.file is not None:
            house.config = house.file
        if what in {"line", "mqtt"}:
            for name in house.oracle.lines:
                house.oracle.restarted(name)
                house.oracle.trouble(name)
        if what == "mqtt":
            house.oracle.broker_trouble()
        house.ask(Wanted.RELOAD)

        def restore() -> None:
            house.file = house.config

        self._later(0.5, restore)

    def _suspend(self) -> None:
        house = self._house
        seconds = self._chance.choice((0.8, 5.0, 15.0, 120.0))
        house.broker.stalled_until = house.clockwork.awake_s + 0.2
        for _ in range(self._chance.choice((0, 3))):
            self._command()
        house.clockwork.suspend(seconds)
        for name in house.oracle.lines:
            house.oracle.trouble(name)
        house.oracle.broker_trouble()
        house.broker.slept(seconds)
        house.oracle.slept(seconds)

    def _restart(self) -> None:
        """Stop and start again."""
        house = self._house
        if not house.runs:
            return
        house.stop()
        house.settle(self._chance.choice((0.1, 3.0, 30.0)))
        house.file = house.config  # with nonsense in it, it would not start
        house.start()


def _conditions(rule: RuleConfig) -> list[tuple[str, int]]:
    return [(one.station_id, one.channel) for one in rule.conditions]


def with_calm(house: House) -> House:
    """Return the house without any trouble."""
    house.broker.mute = house.broker.forgetful = False
    house.broker.listens = True
    house.broker.latency_s = 0.002
    for name, line in house.oracle.lines.items():
        line.set_rate(0.0)
        line.open_error = None
        house.oracle.ports_gone.pop(name, None)
        house.oracle.trouble(name)
    for station in house.oracle.stations.values():
        house.oracle.away(station, away=False)
    return house
