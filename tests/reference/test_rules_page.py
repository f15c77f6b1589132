"""The examples of docs/rules.md, each run by the whole bridge in virtual time."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from proofs.house_fuzz.house import House
from support.config_file import load_text

from bridge.cli.views.rule_words import in_words
from bridge.line.forecast import forecast
from bridge.line.rule_forecast import rule_forecast, rules_too_slow

# What the broker in memory does not send back is logged.
pytestmark = [pytest.mark.warns, pytest.mark.unmeasured]  # hours of virtual time

PAGE = (Path(__file__).parents[2] / "docs" / "rules.md").read_text(encoding="utf-8")
EXAMPLES = dict(re.findall(r"^### (.*?)\n.*?```yaml\n(.*?)```", PAGE, re.MULTILINE | re.DOTALL))

# What is done, one after the other: an input, and for how many seconds it is ON (None: it stays, 0:
# it goes OFF); no input: so many seconds pass. And after each, which outputs are ON.
STORIES: dict[str, list[tuple[str, float | None, set[str]]]] = {
    "Stair light": [
        ("hall/di/1", 0.5, {"hall/do/1"}),
        ("", 100.0, {"hall/do/1"}),
        ("hall/di/2", 0.5, {"hall/do/1"}),
        ("", 90.0, set()),
        ("hall/di/2", 0.5, {"hall/do/1"}),
    ],
    "Two-way switch": [
        ("hall/di/1", None, {"hall/do/1"}),
        ("hall/di/2", None, set()),
        ("hall/di/1", 0, {"hall/do/1"}),
        ("hall/di/2", 0, set()),
    ],
    "Door bell to siren": [
        ("door/di/1", 0.5, {"workshop/do/1"}),
        ("", 2.0, set()),
        ("door/di/1", 0.5, {"workshop/do/1"}),
    ],
    "Gate with a safety input": [
        ("yard/di/1", 0.3, {"yard/do/1"}),
        ("yard/di/6", None, set()),
        ("yard/di/1", 0.3, set()),
        ("yard/di/6", 0, set()),
        ("yard/di/1", 1.5, {"yard/do/2"}),
        ("", 25.0, set()),
    ],
    "Pump with a float switch": [
        ("cellar/di/1", None, set()),  # it has to last for a second
        ("", 1.5, {"cellar/do/1"}),
        ("cellar/di/1", 0, {"cellar/do/1"}),
        ("", 1.5, set()),
        ("cellar/di/1", None, set()),
        ("", 119.0, {"cellar/do/1"}),
        ("", 5.0, set()),
    ],
    "Night mode": [
        ("hall/di/1", 0.3, {"hall/do/1"}),
        ("hall/di/8", None, {"hall/do/1"}),
        ("hall/di/1", 0.3, {"hall/do/1", "hall/do/2"}),
        ("hall/di/1", 1.5, set()),
    ],
}


@contextmanager
def lived_in(folder: Path, title: str, *, broker: bool) -> Iterator[House]:
    """Run the bridge in the house of an example."""
    # Half an hour in virtual time would take long.
    config = load_text(folder, EXAMPLES[title].replace("max_on: 30min", "max_on: 2min"))
    house = House(str(config.lines[0].protocol), 1, config)
    house.broker.listens = broker
    with house.in_place():
        house.start()
        house.settle(6.0)
        yield house
        house.stop()
    assert house.clockwork.errors == []
    assert house.oracle.broken == []


def set_input(house: House, name: str, *, on: bool) -> None:
    """Let an input read so."""
    station_id, _, channel = name.split("/")
    module = house.oracle.stations[station_id].module
    if bool(module.inputs >> (int(channel) - 1) & 1) is not on:
        house.oracle.feed(house.oracle.stations[station_id], int(channel))


def switched_on(house: House) -> set[str]:
    """Return the outputs that are ON."""
    found = set()
    for name, station in house.oracle.stations.items():
        station.module.settle()
        found |= {f"{name}/do/{n}" for n in range(1, 17) if station.module.outputs >> (n - 1) & 1}
    return found


@pytest.mark.slow  # minutes in virtual time
@pytest.mark.parametrize("broker", [True, False])
@pytest.mark.parametrize("title", EXAMPLES)
def test_an_example_does_what_the_page_says(tmp_path: Path, title: str, broker: bool) -> None:
    """With a broker and without one."""
    with lived_in(tmp_path, title, broker=broker) as house:
        for input_name, held_s, expected in STORIES[title]:
            if input_name:
                set_input(house, input_name, on=held_s != 0)
            if held_s:
                house.settle(held_s)
            if input_name and held_s is not None:
                set_input(house, input_name, on=False)
            house.settle(0.9)
            assert switched_on(house) == expected, (input_name, held_s)


def test_there_are_six_examples_and_each_has_its_story() -> None:
    """None of them is left out."""
    assert sorted(EXAMPLES) == sorted(STORIES)
    assert len(EXAMPLES) == 6


def test_what_check_says_on_the_page_is_what_it_says(tmp_path: Path) -> None:
    """The line with the time, for a module on a line of its own."""
    [shown] = re.findall(r"^rule Stairs: (.*)$", PAGE, re.MULTILINE)
    lines = """
lines:
  - id: main
    port: /dev/ttyUSB0
    baud: 9600
    protocol: wisco
    stations:
      - {address: 1, model: DIO100, id: garage, inputs: {3: {gestures: true}}}
      - {address: 2, model: DO100, id: hall}
rules:
  - {name: Stairs, when: garage/di/3, is: short, then: {hall/do/2: TOGGLE}}
"""
    config = load_text(tmp_path, lines)
    plans = {line.id: forecast(line) for line in config.lines}
    [rule] = config.rules
    assert in_words(rule, rule_forecast(rule, config, plans)) == shown
    assert list(rules_too_slow(config, plans)) == []


def test_a_rule_that_cannot_be_in_time_is_named(tmp_path: Path) -> None:
    """Its input is read too seldom: `check` says what to do."""
    stations = "\n".join(f"      - {{address: {n}, model: DIO100, id: s{n}}}" for n in range(1, 32))
    text = f"""
lines:
  - id: main
    port: /dev/ttyUSB0
    baud: 4800
    protocol: modbus-ascii
    stations:
{stations}
rules:
  - {{name: Stairs, when: s1/di/3, is: ON, then: {{s2/do/2: TOGGLE}}}}
"""
    config = load_text(tmp_path, text)
    [told] = rules_too_slow(config, {line.id: forecast(line) for line in config.lines})
    assert "priority: high" in told


def test_a_rule_that_is_switched_off_stays_off_over_a_restart(tmp_path: Path) -> None:
    """The switch of Home Assistant is kept in the state folder, and shown again."""
    topic = "wisco/bridge/rule/stairs-below"
    with lived_in(tmp_path, "Stair light", broker=True) as house:
        house.broker.publish(f"{topic}/set", b"OFF")
        house.settle(1.0)
        assert house.broker.retained[f"{topic}/state"] == b"OFF"
        for _ in range(2):
            set_input(house, "hall/di/1", on=True)
            house.settle(1.0)
            set_input(house, "hall/di/1", on=False)
            house.settle(1.0)
            assert switched_on(house) == set()
            house.stop()
            house.start()
            house.settle(6.0)
            assert house.broker.retained[f"{topic}/state"] == b"OFF"
        house.broker.publish(f"{topic}/set", b"ON")
        house.settle(1.0)
        set_input(house, "hall/di/1", on=True)
        house.settle(1.0)
        assert switched_on(house) == {"hall/do/1"}
