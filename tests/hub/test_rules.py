"""Rules in the main thread: those across lines, and which are switched on."""

from dataclasses import replace
from pathlib import Path

import pytest
from support.fake_worker import FakeWorker
from support.house import CELLAR, GARAGE, make_config
from support.rules import rule

from bridge.config.current import CurrentConfig
from bridge.config.schema import Config, RuleConfig
from bridge.hub.counts import Counts
from bridge.hub.hub import Hub
from bridge.hub.memory import Memory
from bridge.hub.rule_keeper import EVERY_S, RuleKeeper
from bridge.model import (
    PublicEvent,
    Reason,
    RuleDue,
    RuleFired,
    RuleSwitched,
    StationChanged,
    ValuesChanged,
    Verdict,
)

ACROSS = rule("garage/di/1", "ON", {"hall/do/4": "ON"}, conditions={"garage/di/3": "OFF"})
HALL = replace(GARAGE, id="hall", name="Hall")
WAIT_S = 20.0


def house(*rules: RuleConfig) -> Config:
    """Two lines: `main` with the garage, `annex` with the hall."""
    config = make_config(stations=(GARAGE, CELLAR))
    annex = replace(config.lines[0], id="annex", port="/dev/annex", stations=(HALL,))
    return replace(config, lines=(*config.lines, annex), rules=rules)


class Bench:
    """A hub before two lines."""

    def __init__(self, *rules: RuleConfig, memory: Memory | None = None) -> None:
        self.now = 100.0
        self.told: list[PublicEvent] = []
        config = house(*rules)
        self.current = CurrentConfig(config)
        self.lines = {line.id: FakeWorker(line) for line in config.lines}
        self.memory = memory or Memory()
        counts = Counts(self.current, self.told.append)
        self.hub = Hub(
            self.current,
            self.told.append,
            self.lines,
            counts,
            lambda: self.now,
            memory=self.memory,
        )
        for name in ("garage", "hall"):
            self.hub.apply(StationChanged(name, online=True, detail=""))
            self.hub.apply(ValuesChanged(name, inputs=0, outputs=0))
        self.hub.rules.tell_all()
        self.told.clear()

    def due(self, of: RuleConfig, deadline_s: float = 2.0) -> None:
        """A line saw the event of a rule."""
        self.hub.apply(RuleDue(of.id, of.trigger, self.now, self.now + deadline_s))


def test_a_rule_across_lines_is_carried_out_by_the_line_of_its_output() -> None:
    """The command keeps the instants of the event, and names the rule."""
    bench = Bench(ACROSS)
    bench.due(ACROSS, 1.7)
    [command] = bench.lines["annex"].commands
    assert (command.by, command.target, command.payload) == ("rule Stairs", "do/4", "ON")
    assert (command.arrived, command.deadline) == (100.0, 101.7)
    assert bench.told == [RuleFired("stairs")]


def test_a_condition_across_lines_holds_it() -> None:
    """An input that reads otherwise, and one whose module is away."""
    bench = Bench(ACROSS)
    bench.hub.apply(ValuesChanged("garage", inputs=0b100, outputs=0))
    bench.told.clear()
    bench.due(ACROSS)
    bench.hub.apply(StationChanged("garage", online=False, detail=""))
    bench.due(ACROSS)
    held = [one.held for one in bench.told if isinstance(one, RuleFired)]
    assert held[0] == "garage/di/3 is ON"
    assert "not known" in str(held[1])
    assert bench.lines["annex"].commands == []


def test_a_line_is_told_the_rules_of_its_own_inputs() -> None:
    """Those that are switched on, and anew when one is switched."""
    other = rule("hall/di/1", "ON", {"hall/do/1": "ON"}, name="Hall")
    bench = Bench(ACROSS, other)
    assert bench.lines["main"].followed == [ACROSS]
    assert bench.lines["annex"].followed == [other]
    assert bench.hub.rules.switch("stairs", on=False)
    assert bench.told == [RuleSwitched("stairs", False)]
    assert bench.lines["main"].followed == []
    bench.due(ACROSS)  # it was on its way
    assert bench.lines["annex"].commands == []
    assert bench.hub.rules.switch("stairs", on=True)
    assert bench.lines["main"].followed == [ACROSS]


def test_a_rule_that_is_not_there_is_not_switched() -> None:
    """Nothing is published of it."""
    bench = Bench(ACROSS)
    assert not bench.hub.rules.switch("attic", on=False)
    assert bench.told == []


def test_an_event_of_another_configuration_does_nothing() -> None:
    """A rule with the same id has another trigger by now."""
    bench = Bench(ACROSS)
    bench.hub.apply(RuleDue("stairs", ("garage", 2, "ON"), 100.0, 102.0))
    bench.hub.apply(RuleDue("gone", ACROSS.trigger, 100.0, 102.0))
    assert bench.lines["annex"].commands == []
    assert bench.told == []


def test_a_line_that_is_being_replaced_refuses() -> None:
    """Each order has its verdict, also then."""
    bench = Bench(ACROSS)
    del bench.lines["annex"]
    bench.due(ACROSS)
    [verdict] = [one for one in bench.told if isinstance(one, Verdict)]
    assert (verdict.reason, verdict.by) == (Reason.STOPPING, "rule Stairs")


def test_a_flood_of_others_holds_up_no_rule() -> None:
    """The limit is for what arrives."""
    toggles = rule("garage/di/1", "ON", {"hall/do/4": "TOGGLE"})
    bench = Bench(toggles)
    for _ in range(100):
        bench.due(toggles)
    assert len(bench.lines["annex"].commands) == 100


# --- over a restart -----------------------------------------------------------------------------


def _keeper(folder: Path, memory: Memory) -> RuleKeeper:
    config = replace(house(ACROSS), state_dir=folder)
    return RuleKeeper(CurrentConfig(config), memory)


def test_a_rule_that_is_off_stays_off_over_a_restart(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The file is written at the stop; as long as there is none, all are on without a word."""
    before, after = Memory(), Memory()
    keeper = _keeper(tmp_path, before)
    keeper.open()
    assert (before.rules_off, caplog.messages) == (frozenset(), [])
    before.rules_off = frozenset({"stairs"})
    keeper.close(WAIT_S)
    _keeper(tmp_path, after).open()
    assert after.rules_off == {"stairs"}
    bench = Bench(ACROSS, memory=after)
    assert bench.lines["main"].followed == []


def test_a_switch_that_is_turned_all_the_time_wears_out_no_card(tmp_path: Path) -> None:
    """At most one write in 10 s; the last word is in the file at the stop."""
    memory = Memory()
    keeper = _keeper(tmp_path, memory)
    keeper.open()
    path, writes, known = tmp_path / "rules-wisco.json", 0, None
    for tenth in range(300):
        memory.rules_off = frozenset({"stairs"} if tenth % 2 else ())
        keeper.tick(100.0 + tenth / 10)
        keeper._writer.wait(WAIT_S)
        found = path.stat().st_ino if path.exists() else None
        writes += found != known
        known = found
    assert 1 <= writes <= 300 / 10 / EVERY_S + 1
    keeper.close(WAIT_S)
    assert path.read_text() == '{"off": ["stairs"]}\n'


def test_a_rule_that_comes_with_a_reload_is_off_as_it_was_left(tmp_path: Path) -> None:
    """The file is read even if the first configuration has no rule."""
    (tmp_path / "rules-wisco.json").write_text('{"off": ["stairs"]}')
    memory = Memory()
    RuleKeeper(CurrentConfig(replace(house(), state_dir=tmp_path)), memory).open()
    assert memory.rules_off == {"stairs"}


def test_another_folder_gets_the_file_too(tmp_path: Path) -> None:
    """A configuration that names another one is followed, without a switch."""
    memory = Memory()
    keeper = _keeper(tmp_path / "old", memory)
    keeper.open()
    memory.rules_off = frozenset({"stairs"})
    keeper.tick(100.0)
    keeper._writer.wait(WAIT_S)
    keeper._current.replace(replace(house(ACROSS), state_dir=tmp_path / "new"))
    keeper.close(WAIT_S)
    assert (tmp_path / "new" / "rules-wisco.json").read_text() == '{"off": ["stairs"]}\n'


@pytest.mark.warns
@pytest.mark.parametrize("text", ["", "{", '{"off": [1]}', "[" * 100_000])
def test_a_damaged_file_leaves_all_rules_off(
    tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    """One that was switched off must not act again; the log says what to do."""
    (tmp_path / "rules-wisco.json").write_text(text)
    memory = Memory()
    _keeper(tmp_path, memory).open()
    assert memory.rules_off == {"stairs"}
    assert "all are off until each is switched on" in caplog.text


def test_without_rules_nothing_is_written(tmp_path: Path) -> None:
    """Not even a folder."""
    keeper = RuleKeeper(CurrentConfig(replace(house(), state_dir=tmp_path / "none")), Memory())
    keeper.open()
    keeper.tick(1000.0)
    keeper.close(WAIT_S)
    assert list(tmp_path.iterdir()) == []
