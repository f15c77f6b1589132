"""Draws a house: its lines, modules and rules."""

import random
from dataclasses import replace
from pathlib import Path

from bridge.config.schema import (
    Config,
    CoverConfig,
    GestureConfig,
    HomeAssistantConfig,
    InputConfig,
    InputState,
    LineConfig,
    MqttConfig,
    OnLossConfig,
    OutputConfig,
    RuleConfig,
    RuleOrder,
    StationConfig,
)
from bridge.model import DIO100, DO100, LineProtocol, Writes, bit
from proofs.house_fuzz.broker import BASE, STATUS

BUTTONS = (7, 8)
WAYS = ("modbus-rtu", "modbus-ascii", "wisco", "wisco-only")


def draw_config(way: str, chance: random.Random) -> Config:
    """Return a house with one or two lines of one way to speak."""
    protocol = LineProtocol(way.removesuffix("-only"))
    lines = tuple(_line(f"l{n}", protocol, chance) for n in range(1, 2 + (chance.random() < 0.5)))
    return Config(
        MqttConfig("broker", 1883, BASE, "client", "auto"),
        HomeAssistantConfig(chance.choice(("off", "off", "device")), "homeassistant", STATUS),
        Path("/nowhere"),
        lines,
        _rules(lines, chance),
    )


def _line(name: str, protocol: LineProtocol, chance: random.Random) -> LineConfig:
    first = 0 if protocol is LineProtocol.WISCO and chance.random() < 0.2 else 1
    addresses = chance.sample(range(first, 32), chance.randint(1, 3))
    stations = tuple(_station(f"{name}s{a}", a, chance) for a in addresses)
    baud = chance.choice((4800, 4800, 9600, 9600, 9600, 19200, 57600))
    return LineConfig(name, f"/dev/{name}", baud, protocol, stations, Writes.AUTO)


def _station(name: str, address: int, chance: random.Random) -> StationConfig:
    model = DO100 if chance.random() < 0.5 else DIO100
    free = list(range(1, model.outputs + 1))
    chance.shuffle(free)
    outputs = {n: OutputConfig(n) for n in free}
    interlock: list[int] = []
    covers: tuple[CoverConfig, ...] = ()
    if chance.random() < 0.5:
        opening, closing = free.pop(), free.pop()
        times = chance.uniform(2, 6), chance.uniform(2, 6)
        covers = (CoverConfig("blind", "Blind", opening, closing, *times),)
        interlock.append(covers[0].outputs)
    if chance.random() < 0.5:
        interlock.append(bit(free.pop()) | bit(free.pop()))
    if chance.random() < 0.6:
        n = free.pop()
        outputs[n] = replace(outputs[n], max_on_s=chance.uniform(3, 9))
    if chance.random() < 0.6:
        n = free.pop()
        rule = OnLossConfig(chance.uniform(1, 7), chance.random() < 0.5)
        outputs[n] = replace(outputs[n], on_loss=rule)
    if chance.random() < 0.5:
        n = free.pop()
        outputs[n] = replace(outputs[n], read_only=True)
    while free and chance.random() < 0.6:
        n = free.pop()
        outputs[n] = replace(outputs[n], mode="pulse")
    return StationConfig(
        address,
        model,
        name,
        name,
        tuple(_input(n) for n in range(1, model.inputs + 1)),
        tuple(outputs[n] for n in sorted(outputs)),
        interlock=tuple(interlock),
        interlock_dead_s=chance.choice((0.2, 0.5, 1.0)),
        covers=covers,
        high_priority=chance.random() < 0.2,
    )


def _input(channel: int) -> InputConfig:
    button = GestureConfig(double_s=0.0 if channel == BUTTONS[0] else 0.4)
    return InputConfig(channel, gestures=button if channel in BUTTONS else None)


def _rules(lines: tuple[LineConfig, ...], chance: random.Random) -> tuple[RuleConfig, ...]:
    """Return some rules where there are inputs: on one line, across lines, with conditions."""
    stations = [config for line in lines for config in line.stations]
    with_inputs = [config for config in stations if config.inputs]
    if not with_inputs:
        return ()
    return tuple(_rule(n, with_inputs, stations, chance) for n in range(chance.randint(1, 5)))


def _rule(
    number: int,
    with_inputs: list[StationConfig],
    stations: list[StationConfig],
    chance: random.Random,
) -> RuleConfig:
    channel = chance.choice((*BUTTONS, *range(1, 6), *range(1, 6)))
    events = ("ON", "OFF", "ON", "OFF")
    if channel in BUTTONS:
        events = ("short", "long", "double" if channel != BUTTONS[0] else "short", "ON")
    orders: dict[tuple[str, str], RuleOrder] = {}
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        order = _order(chance.choice(stations), chance)
        clash = any(
            order.station_id == o.station_id and order.mask & o.mask for o in orders.values()
        )
        if not clash:
            orders[order.station_id, order.target] = order
    conditions: tuple[InputState, ...] = ()
    if chance.random() < 0.3:
        other = chance.choice(with_inputs)
        conditions = (InputState(other.id, chance.randint(9, 12), chance.random() < 0.5),)
    return RuleConfig(
        f"rule{number}",
        f"Rule {number}",
        chance.choice(with_inputs).id,
        channel,
        chance.choice(events),
        tuple(orders.values()),
        conditions,
        broker_away=chance.random() < 0.25,
    )


def _order(config: StationConfig, chance: random.Random) -> RuleOrder:
    if config.covers and chance.random() < 0.3:
        word = chance.choice(("OPEN", "CLOSE", "STOP"))
        return RuleOrder(config.id, "cover/blind", word, config.covers[0].outputs)
    locked = config.cover_outputs | config.read_only_outputs
    output = chance.choice([one for one in config.outputs if not bit(one.channel) & locked])
    words = ("PRESS", "ON", "OFF") if output.mode == "pulse" else ("ON", "OFF", "TOGGLE")
    target = f"do/{output.channel}"
    return RuleOrder(config.id, target, chance.choice(words), bit(output.channel))


def changed(config: Config, what: str, chance: random.Random) -> Config:
    """Return the same house with one thing changed: nothing, a line, a name, or the broker."""
    if what == "line":
        at = chance.randrange(len(config.lines))
        line = config.lines[at]
        station_config = replace(line.stations[0], name=f"Name {chance.randrange(10**6)}")
        line = replace(line, stations=(station_config, *line.stations[1:]))
        return replace(config, lines=(*config.lines[:at], line, *config.lines[at + 1 :]))
    if what == "mqtt":
        client = f"client{chance.randrange(10**6)}"
        return replace(config, mqtt=replace(config.mqtt, client_id=client))
    if what == "discovery":
        discovery = "device" if config.homeassistant.discovery == "off" else "off"
        return replace(config, homeassistant=replace(config.homeassistant, discovery=discovery))
    return config
