import json
import logging
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pytest
from support.fake_worker import fake_workers
from support.links import prove
from support.mqtt_side import ATTIC, CONFIG, GARAGE, MAIN, FakeConnection
from support.rules import rule

from bridge.config.schema import Config, LineConfig
from bridge.daemon.systemd import Notifier
from bridge.daemon.wiring import Outside, build_tree
from bridge.errors import ConfigError, Problem
from bridge.model import (
    LineChanged,
    LineEvent,
    ProblemChanged,
    Reason,
    StationChanged,
    Status,
    ValuesChanged,
    Verdict,
)
from bridge.mqtt.announce.announcer import STEP_S
from bridge.mqtt.announce.survey import QUIET_S
from bridge.mqtt.events import Acknowledged, Connected, Received, Subscribed
from bridge.transport.lock import LockHeldError

pytestmark = pytest.mark.warns  # what goes wrong here is logged

STARTED = datetime(2024, 5, 1, 12, tzinfo=UTC)
CELLAR = replace(ATTIC, id="cellar", name="Cellar")
BACK = replace(MAIN, id="back", stations=(CELLAR,))
BEFORE = replace(CONFIG, lines=(MAIN, BACK))
STAIRS = rule("garage/di/1", "ON", {"garage/do/1": "ON"})
PROBLEM = ConfigError([Problem("config.yaml", 3, 5, "no such model")])


class NotedNotifier(Notifier):
    """Remembers what systemd would be told."""

    def __init__(self) -> None:
        super().__init__({})
        self.told: list[str] = []

    def ready(self, status: str) -> None:
        """READY."""
        self.told.append(f"ready: {status}")

    def reloading(self) -> None:
        """RELOADING."""
        self.told.append("reloading")


class Reloading:
    """All of a bridge but its threads: workers, the client and the file are the test's."""

    def __init__(self) -> None:
        self.now = 100.0
        self.file: Config | ConfigError | LockHeldError = BEFORE
        self.made, make = fake_workers()
        self.undrained: list[LineEvent] = []
        self.held: dict[str, bytes] = {}
        self.connection = FakeConnection()
        self.notifier = NotedNotifier()
        tree = build_tree(
            BEFORE,
            Outside(self.connection, lambda: self.now, lambda: STARTED, jitter_s=lambda: 0.0),
            make,
            lambda _told: None,
            load=self._load,
            notifier=self.notifier,
        )
        self.link, self.publisher = tree.broker.link, tree.broker.publisher
        self.session = tree.broker.session
        self.current = tree.current
        self.counts, self.hub, self.reload = tree.counts, tree.hub, tree.reload
        tree.lines.start(BEFORE.lines)
        self.session.handle(Connected("5", self.now), self.now)
        prove(self.link, self.now)
        for line in BEFORE.lines:
            self.come_online(line)
        self.settle()

    def _load(self) -> Config:
        if isinstance(self.file, ConfigError | LockHeldError):
            raise self.file
        return self.file

    def come_online(self, line: LineConfig) -> None:
        """The port and the modules of a line are there."""
        self.hub.apply(LineChanged(line.id, online=True, detail=""))
        for config in line.stations:
            self.hub.apply(ValuesChanged(config.id, 0, 0))
            self.hub.apply(ProblemChanged(config.id, None, ""))
            self.hub.apply(StationChanged(config.id, online=True, detail=""))

    def send(self) -> dict[str, bytes]:
        """Lets the broker take all that is due, and returns it."""
        sent: dict[str, bytes] = {}
        self.session.tick(self.now)
        while messages := self.connection.taken():
            sent |= {message.topic: message.payload for message in messages}
            self.held |= {m.topic: m.payload for m in messages if m.retain}
            for token in self.connection.unacknowledged:
                self.session.handle(Acknowledged(token), self.now)
            self.connection.unacknowledged.clear()
            self.session.tick(self.now)
        self.held = {topic: payload for topic, payload in self.held.items() if payload}
        return sent

    def settle(self) -> None:
        """Lets time pass until everything is announced and tidied up."""
        self.send()
        self.session.handle(Subscribed(()), self.now)
        for topic, payload in self.held.items():
            self.session.handle(Received(topic, payload, retain=True, at=self.now), self.now)
        for pause_s in (QUIET_S, STEP_S, STEP_S):
            self.now += pause_s
            self.session.handle(Received("wisco/bridge/ping", b"", False, self.now), self.now)
            self.send()

    def tick(self) -> None:
        """A round of the main loop."""
        self.reload.tick(self._drain)

    def _drain(self) -> None:
        for event in self.undrained:
            self.hub.apply(event)
        self.undrained.clear()

    def go_over(self, config: Config) -> None:
        """The file becomes this, it is read, and who was asked to end ends."""
        self.file = config
        self.reload.ask()
        self.tick()
        for worker in self.made:
            worker.alive = worker.alive and not worker.stops
        self.tick()

    def request(self) -> None:
        """Somebody asks over MQTT, on a link that was just proven."""
        self.session.handle(Connected("5", self.now), self.now)
        prove(self.link, self.now)
        topic, payload = "wisco/bridge/request/reload", b'{"id": 1}'
        self.session.handle(Received(topic, payload, retain=False, at=self.now), self.now)

    def answer(self) -> Any:
        """What the one who asked is told."""
        return json.loads(self.send()["wisco/bridge/response/reload"])

    def switch(self, station_id: str, output: int) -> Any:
        """A command; returns its verdict, or None where a worker has it."""
        self.session.handle(Connected("5", self.now), self.now)
        prove(self.link, self.now)
        topic = f"wisco/{station_id}/do/{output}/set"
        self.session.handle(Received(topic, b"ON", retain=False, at=self.now), self.now)
        verdict = self.send().get(f"wisco/{station_id}/result")
        return None if verdict is None else json.loads(verdict)


@pytest.fixture
def world() -> Reloading:
    """Two lines, online."""
    return Reloading()


def of(world: Reloading, station_id: str) -> set[str]:
    """What is retained about a station."""
    return {
        topic for topic in world.held if f"/{station_id}" in topic or f"__{station_id}" in topic
    }


RENAMED = replace(BEFORE, lines=(MAIN, replace(BACK, stations=(replace(CELLAR, name="Wine"),))))
WITHOUT_CELLAR = replace(BEFORE, lines=(MAIN,))


def test_a_line_that_is_the_same_is_not_touched(world: Reloading) -> None:
    """Its worker and its states are those of before; nothing of it is published but devices."""
    before = dict(world.held)
    world.go_over(RENAMED)
    sent = world.send()
    assert [worker.stops for worker in world.made] == [0, 1, 0]
    assert [w.config.id for w in world.made if w.alive] == ["main", "back"]
    assert not [t for t in sent if "garage" in t or "attic" in t or "/main/" in t]
    world.settle()
    assert {t for t in of(world, "garage") if world.held[t] != before[t]} == set()
    assert world.switch("garage", 1) is None
    assert [command.target for command in world.made[0].commands] == ["do/1"]


def test_a_line_that_changed_is_offline_until_it_is_back(world: Reloading) -> None:
    """Its stations and its port; the values stay as last read; then all is online again."""
    world.go_over(RENAMED)
    sent = world.send()
    assert sent["wisco/cellar/availability"] == b"offline"
    assert sent["wisco/bridge/line/back/availability"] == b"offline"
    assert "wisco/cellar" not in sent
    assert world.switch("cellar", 16)["reason"] == "offline"
    world.come_online(BACK)
    assert world.send()["wisco/cellar/availability"] == b"online"
    assert world.switch("cellar", 16) is None
    assert [command.target for command in world.made[2].commands] == ["do/16"]


def test_nothing_changes_before_the_old_workers_have_ended(world: Reloading) -> None:
    """Meanwhile commands to their lines are refused, and what they still tell is published."""
    world.file = WITHOUT_CELLAR
    world.reload.ask()
    world.tick()
    world.tick()
    assert not [topic for topic in world.send() if topic.endswith("/availability")]
    assert world.switch("cellar", 16)["reason"] == "stopping"
    assert world.switch("garage", 1) is None
    last = Verdict("cellar", "do/16", "ON", Status.REFUSED, 5, reason=Reason.STOPPING)
    world.undrained.append(last)
    world.made[1].alive = False
    world.tick()
    assert "wisco/cellar/result" in world.send()
    assert world.current.config is WITHOUT_CELLAR


def test_a_station_that_is_gone_leaves_nothing(world: Reloading) -> None:
    """Offline first, then cleared: states, and what was announced."""
    assert len(of(world, "cellar")) > 4
    world.go_over(WITHOUT_CELLAR)
    assert world.send()["wisco/cellar/availability"] == b"offline"
    world.settle()
    assert of(world, "cellar") == set()
    assert "wisco/bridge/line/back/availability" not in world.held
    assert [line["id"] for line in json.loads(world.held["wisco/bridge/info"])["lines"]] == ["main"]


def test_a_station_that_came_back_in_time_is_not_cleared(world: Reloading) -> None:
    """Two reloads in a row: what counts is the last configuration."""
    before = of(world, "cellar")
    world.go_over(WITHOUT_CELLAR)
    world.send()
    world.go_over(BEFORE)
    world.come_online(BACK)
    world.settle()
    assert of(world, "cellar") == before


def test_a_station_that_comes_back_later_is_all_there(world: Reloading) -> None:
    """What was cleared once is not cleared again."""
    before = of(world, "cellar")
    world.go_over(WITHOUT_CELLAR)
    world.settle()
    world.go_over(BEFORE)
    world.come_online(BACK)
    for _ in range(2):
        world.settle()
    assert of(world, "cellar") == before


def test_channels_that_are_left_out_are_cleared(world: Reloading) -> None:
    """The others of the station stay."""
    fewer = replace(GARAGE, outputs=GARAGE.outputs[:1])
    world.go_over(replace(BEFORE, lines=(replace(MAIN, stations=(fewer, ATTIC)), BACK)))
    world.settle()
    assert "wisco/garage/do/1" in world.held
    assert "wisco/garage/do/4" not in world.held


def test_a_bad_file_changes_nothing(world: Reloading, caplog: pytest.LogCaptureFixture) -> None:
    """Every problem is in the log, and in the answer of who asked."""
    before = dict(world.held)
    world.request()
    world.file = PROBLEM
    world.tick()
    answer = world.answer()
    assert (answer["status"], answer["id"]) == ("error", 1)
    assert answer["error"] == "config.yaml:3:5: no such model"
    assert "config.yaml:3:5: no such model" in caplog.text
    assert "runs on as it was" in caplog.text
    assert [worker.stops for worker in world.made] == [0, 0]
    assert world.current.config is BEFORE
    assert world.held == before


def test_an_equal_file_changes_nothing(world: Reloading, caplog: pytest.LogCaptureFixture) -> None:
    """It says so."""
    caplog.set_level(logging.INFO)
    world.request()
    world.file = replace(BEFORE)
    world.tick()
    assert world.answer()["data"] == {"kept": ["main", "back"], "stopped": [], "started": []}
    assert "nothing to do" in caplog.text
    assert [worker.stops for worker in world.made] == [0, 0]


def test_who_asked_is_told_what_became_of_the_lines(world: Reloading) -> None:
    """When it is done, and not before."""
    world.request()
    world.file = replace(BEFORE, lines=(MAIN, replace(BACK, id="loft")))
    world.tick()
    assert "wisco/bridge/response/reload" not in world.send()
    world.made[1].alive = False
    world.tick()
    assert world.answer() == {
        "status": "ok",
        "data": {"kept": ["main"], "stopped": ["back"], "started": ["loft"]},
        "id": 1,
    }


def test_a_second_asker_waits_for_the_first_to_be_done(world: Reloading) -> None:
    """Then the file is read once more: it may have changed meanwhile."""
    world.file = RENAMED
    world.reload.ask()
    world.tick()
    world.request()
    world.file = BEFORE
    world.tick()
    world.made[1].alive = False
    world.tick()
    assert world.current.config is RENAMED
    world.tick()
    world.made[2].alive = False
    world.tick()
    assert world.current.config is BEFORE
    assert world.answer()["status"] == "ok"


def test_systemd_hears_of_the_beginning_and_the_end(world: Reloading) -> None:
    """Of every reload, whatever came of it: `systemctl reload` waits for that."""
    world.reload.ask()
    world.tick()
    world.file = PROBLEM
    world.reload.ask()
    world.tick()
    assert world.notifier.told == ["reloading", "ready: 2 lines"] * 2
    world.go_over(WITHOUT_CELLAR)
    assert world.notifier.told[4:] == ["reloading", "ready: 1 lines"]


def test_a_base_topic_that_another_bridge_has_is_a_problem_too(world: Reloading) -> None:
    """The bridge runs on as it was, and says why."""
    world.file = LockHeldError("another bridge runs here with the base topic house")
    world.request()
    world.tick()
    assert world.answer()["error"] == "another bridge runs here with the base topic house"
    assert world.current.config is BEFORE
    assert world.reload.anew is None


@pytest.mark.parametrize(
    "other",
    [
        replace(BEFORE, mqtt=replace(BEFORE.mqtt, password="another")),  # noqa: S106  # no secret
        replace(BEFORE, mqtt=replace(BEFORE.mqtt, base_topic="house")),
        replace(BEFORE, homeassistant=replace(BEFORE.homeassistant, status_topic="ha/status")),
    ],
)
def test_another_connection_takes_a_new_start(world: Reloading, other: Config) -> None:
    """Lines are left alone until then."""
    world.request()
    world.file = other
    world.tick()
    assert world.current.config is BEFORE
    assert world.reload.anew is other
    assert world.answer()["data"]["kept"] == []
    assert [worker.stops for worker in world.made] == [0, 0]


def test_another_form_of_the_announcements_takes_none(world: Reloading) -> None:
    """The entities move over while the lines work on."""
    single = replace(BEFORE.homeassistant, discovery="single")
    world.go_over(replace(BEFORE, homeassistant=single))
    world.settle()
    assert [worker.stops for worker in world.made] == [0, 0]
    announced = [topic for topic in world.held if topic.startswith("homeassistant/")]
    assert announced
    assert not [topic for topic in announced if "/device/" in topic]


def test_rules_are_exchanged_and_no_line_is_started_anew() -> None:
    """A line that stays gets its new rules; a rule that is gone leaves no topic."""
    bridge = Reloading()
    bridge.go_over(replace(BEFORE, rules=(STAIRS,)))
    bridge.settle()
    assert [worker.stops for worker in bridge.made] == [0, 0]
    assert [worker.followed for worker in bridge.made] == [[STAIRS], []]
    assert bridge.held["wisco/bridge/rule/stairs/state"] == b"ON"
    assert b"rule_stairs_switch" in bridge.held["homeassistant/device/wisco__bridge/config"]
    bridge.hub.rules.switch("stairs", on=False)
    bridge.go_over(BEFORE)
    bridge.settle()
    assert [worker.followed for worker in bridge.made] == [[], []]
    assert "wisco/bridge/rule/stairs/state" not in bridge.held
    bridge.go_over(replace(BEFORE, rules=(STAIRS,)))
    bridge.settle()
    assert [worker.followed for worker in bridge.made] == [[], []]  # it is off as before
    assert bridge.held["wisco/bridge/rule/stairs/state"] == b"OFF"
