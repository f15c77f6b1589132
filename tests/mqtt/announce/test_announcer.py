import json
import logging
from collections.abc import Mapping
from dataclasses import replace

import pytest
from support.house import CELLAR, GARAGE, make_config
from support.world import World

from bridge.config.schema import Config, CountConfig, InputConfig
from bridge.mqtt.announce.announcer import STEP_S
from bridge.mqtt.announce.discovery import discovery_messages
from bridge.mqtt.announce.migration import MIGRATE
from bridge.mqtt.announce.survey import LONGEST_S, QUIET_S
from bridge.mqtt.events import Received

OLD = "wisco/old/availability"
CELLAR_DEVICE = "homeassistant/device/wisco__main_02/config"
DEVICE = make_config("device")


def retained(config: Config) -> dict[str, bytes]:
    """What the broker holds after this was announced."""
    return {message.topic: message.payload for message in discovery_messages(config)}


class Announcing(World):
    """An announcer on a virtual clock, before a broker that holds some retained messages."""

    def __init__(self, config: Config, held: Mapping[str, bytes]) -> None:
        super().__init__(config, now=100.0)
        self.held = dict(held)
        self.announced: list[float] = []
        self.purged: list[list[str]] = []

    def connect(self, protocol: str = "5") -> None:
        """The broker takes us."""
        self.outbox.connected([], self.now)
        self.announcer.connected(self.now, protocol, lambda: self.announced.append(self.now))

    def cut(self) -> None:
        """The connection ends."""
        self.announcer.disconnected()
        self.outbox.disconnected(self.now)
        self.connection.filters.clear()

    def answer(self) -> None:
        """The broker answers the subscription, then it delivers what it retains."""
        self.announcer.answered(self.now)
        for topic, payload in self.held.items():
            self.announcer.receive(Received(topic, payload, retain=True, at=self.now), self.now)

    def pass_time(self, seconds: float) -> dict[str, bytes]:
        """Lets time pass; the broker takes and acknowledges what is sent, which is returned."""
        self.now += seconds
        self.announcer.tick(self.now)
        sent = {message.topic: message.payload for message in self.pumped()}
        self.held |= sent
        self.held = {topic: payload for topic, payload in self.held.items() if payload}
        return sent


def test_it_looks_first_and_then_announces() -> None:
    """Nothing is announced before the broker has said what it retains; then all at once."""
    world = Announcing(DEVICE, {})
    world.connect()
    assert "wisco/+/availability" in world.connection.filters
    assert "homeassistant/device/+/config" in world.connection.filters
    assert world.pass_time(1.0) == {}
    world.answer()
    assert world.pass_time(QUIET_S / 2) == {}
    assert world.pass_time(QUIET_S / 2) == retained(DEVICE)
    assert world.connection.filters == []
    assert world.announced == [world.now]


def test_it_waits_for_the_last_of_what_is_retained() -> None:
    """Each delivery makes the look last a little longer."""
    world = Announcing(DEVICE, {"homeassistant/switch/zigbee/1/config": b"{}"})
    world.connect()
    for _ in range(5):
        world.answer()
        assert world.pass_time(0.9 * QUIET_S) == {}
    assert world.pass_time(0.2 * QUIET_S) == retained(DEVICE)


def test_a_broker_that_does_not_answer_does_not_hold_it_up_for_ever() -> None:
    """Devices are announced after a bounded time; without the whole picture no state is cleared."""
    world = Announcing(DEVICE, {OLD: b"offline"})
    world.connect()
    received = Received(OLD, b"offline", retain=True, at=world.now)
    world.announcer.receive(received, world.now)
    assert world.pass_time(LONGEST_S - 0.1) == {}
    assert world.pass_time(0.1) == retained(DEVICE)
    assert world.held[OLD] == b"offline"


def test_a_broker_that_never_ends_does_not_hold_it_up_for_ever() -> None:
    """Whoever keeps the retained messages flowing delays us for a bounded time."""
    world = Announcing(DEVICE, {OLD: b"offline"})
    world.connect()
    sent: dict[str, bytes] = {}
    for _ in range(round(LONGEST_S * 10) + 1):
        world.answer()
        sent |= world.pass_time(0.1)
    assert sent == retained(DEVICE)


def test_live_messages_are_not_retained_ones() -> None:
    """What is published while it looks neither counts nor prolongs the look."""
    world = Announcing(DEVICE, {})
    world.connect()
    world.answer()
    for _ in range(2):
        live = Received(OLD, b"offline", retain=False, at=world.now)
        world.announcer.receive(live, world.now)
        world.pass_time(QUIET_S / 2)
    assert world.held == retained(DEVICE)


def test_what_is_left_over_is_cleared_and_named(caplog: pytest.LogCaptureFixture) -> None:
    """After the others were announced: first devices, a step later states. One line tells."""
    caplog.set_level(logging.INFO)
    config = make_config("device", stations=(GARAGE,))
    gone = {f"wisco/old/do/{n}": b"ON" for n in range(1, 17)}
    world = Announcing(config, {**retained(DEVICE), **gone})
    world.connect()
    world.answer()
    assert world.pass_time(QUIET_S) == retained(config)
    assert world.announced == [world.now]
    assert world.pass_time(STEP_S) == {CELLAR_DEVICE: b""}
    assert world.pass_time(STEP_S) == dict.fromkeys(gone, b"")
    assert world.held == retained(config)
    [record] = caplog.records
    assert "wisco/old/do/1, " in record.getMessage()
    assert "and 12 more" in record.getMessage()


@pytest.mark.parametrize(("old", "new"), [("single", "device"), ("device", "single")])
def test_a_migration_goes_step_by_step(old: str, new: str) -> None:
    """Asked for, then announced, then cleared, with a pause between: online after the second."""
    world = Announcing(make_config(new), retained(make_config(old)))
    before = dict(world.held)
    world.connect()
    world.answer()
    assert world.pass_time(QUIET_S) == dict.fromkeys(before, MIGRATE)
    assert world.pass_time(STEP_S - 0.1) == {}
    assert world.announced == []
    assert world.pass_time(0.1) == retained(make_config(new))
    assert world.announced == [world.now]
    assert world.pass_time(STEP_S - 0.1) == {}
    assert world.pass_time(0.1) == dict.fromkeys(before, b"")
    assert world.held == retained(make_config(new))


@pytest.mark.parametrize("steps", [0, 1, 2])
def test_a_cut_in_the_middle_is_made_good(steps: int) -> None:
    """Over the next connection nothing of the old plan goes out before it looked again."""
    world = Announcing(make_config("device"), retained(make_config("single")))
    world.connect()
    world.answer()
    for pause_s in (QUIET_S, STEP_S)[:steps]:
        world.pass_time(pause_s)
    world.cut()
    assert world.pass_time(10.0) == {}
    world.connect()
    assert world.pass_time(1.0) == {}
    world.answer()
    for pause_s in (QUIET_S, STEP_S, STEP_S):
        world.pass_time(pause_s)
    assert world.held == retained(make_config("device"))


def test_home_assistants_birth_is_answered_with_what_was_announced() -> None:
    """Before there is anything announced there is nothing to repeat."""
    world = Announcing(DEVICE, {})
    world.connect()
    world.announcer.again()
    assert world.pass_time(0.1) == {}
    world.answer()
    world.pass_time(QUIET_S)
    world.announcer.again()
    assert world.pass_time(0.1) == retained(DEVICE)


def test_a_purge_looks_again_and_tells_what_it_cleared() -> None:
    """Once for each that asked; what is announced is not sent again."""
    world = Announcing(DEVICE, {})
    world.connect()
    world.answer()
    world.pass_time(QUIET_S)
    world.held[OLD] = b"offline"
    for _ in range(2):
        world.announcer.purge(world.purged.append, world.now)
    assert len(world.connection.filters) == len(set(world.connection.filters))
    world.answer()
    assert world.pass_time(QUIET_S) == {}
    assert world.pass_time(STEP_S) == {OLD: b""}
    assert world.purged == [[OLD], [OLD]]


@pytest.mark.parametrize(
    ("config", "delivered"),
    [
        (make_config("device", stations=(GARAGE,)), False),
        (make_config("device", prefix="ha"), True),
    ],
    ids=["a station less", "another prefix"],
)
def test_a_new_configuration_is_announced_without_a_new_connection(
    config: Config, delivered: bool
) -> None:
    """Nothing of the old one is left, under an old prefix neither, nor where we may not read."""
    world = Announcing(DEVICE, {})
    world.connect()
    world.answer()
    world.pass_time(QUIET_S)
    world.current.replace(config)
    world.announcer.config_replaced(set(), world.now)
    if delivered:
        world.answer()
    else:
        world.announcer.answered(world.now)
    world.pass_time(QUIET_S)
    world.pass_time(STEP_S)
    assert world.held == retained(config)


def test_a_new_configuration_while_there_is_no_broker_waits_for_it() -> None:
    """Nothing is sent, and at the connect it is what is announced."""
    world = Announcing(DEVICE, {})
    config = make_config("device", stations=(CELLAR,))
    world.current.replace(config)
    world.announcer.config_replaced(set(), world.now)
    assert world.connection.filters == []
    world.connect()
    world.answer()
    world.pass_time(QUIET_S)
    assert world.held == retained(config)
    assert json.loads(world.held[CELLAR_DEVICE])["device"]["name"] == "main_02"


def test_what_is_announced_goes_by_the_connection() -> None:
    """A broker that speaks MQTT 5 now, and another protocol after its change, is told of both."""
    world = Announcing(DEVICE, {})
    for protocol in ("5", "3.1.1", "5"):
        world.connect(protocol)
        world.answer()
        sent = world.pass_time(QUIET_S)
        told = {message.topic: message.payload for message in discovery_messages(DEVICE, protocol)}
        assert {topic: sent.get(topic) for topic in told} == told
        world.cut()


def test_what_the_broker_retains_of_counts_is_told_after_each_look() -> None:
    """Of inputs that are counted, and only what is a count: the rest is cleared, or passed over."""
    garage = replace(GARAGE, inputs=(InputConfig(1, count=CountConfig()), InputConfig(16)))
    config = make_config(stations=(garage,))
    held = {
        "wisco/garage/di/1/count": b"12",
        "wisco/garage/di/16/count": b"3",
        "wisco/garage/di/2/count": b"4",
    }
    world = Announcing(config, held)
    world.connect()
    world.answer()
    assert world.found == []
    world.pass_time(QUIET_S)
    assert world.found == [{("garage", 1): 12}]
    world.pass_time(STEP_S)
    world.pass_time(STEP_S)
    assert set(world.held) & set(held) == {"wisco/garage/di/1/count"}


@pytest.mark.parametrize("payload", [b"", b"-1", b"1.5", b"012", b"12 ", b"ON", b"9" * 16])
def test_what_is_no_count_is_passed_over(payload: bytes) -> None:
    """Anybody may write to a broker."""
    garage = replace(GARAGE, inputs=(InputConfig(1, count=CountConfig()),))
    config = make_config(stations=(garage,))
    world = Announcing(config, {"wisco/garage/di/1/count": payload})
    world.connect()
    world.answer()
    world.pass_time(QUIET_S)
    assert world.found == [{}]
