"""The switch of a rule over MQTT, and what is told of rules."""

import logging
from dataclasses import replace

import pytest
from support.mqtt_side import CONFIG
from support.rules import rule
from support.world import World

from bridge.model import Reason, RuleFired, RuleSwitched, Status, Verdict
from bridge.mqtt.plain import plain_subscriptions
from bridge.mqtt.topics import Topics

SET = "wisco/bridge/rule/stairs/set"
STAIRS = rule("garage/di/1", "ON", {"garage/do/1": "ON"})


@pytest.fixture
def world() -> World:
    """A session whose link is proven."""
    world = World(replace(CONFIG, rules=(STAIRS,)), now=100.0)
    world.come_up()
    return world


@pytest.mark.parametrize(("payload", "on"), [(b"ON", True), (b"OFF", False)])
def test_a_rule_is_switched(world: World, payload: bytes, on: bool) -> None:
    """By a plain word."""
    world.receive(SET, payload)
    assert world.switched == [("stairs", on)]


@pytest.mark.warns
@pytest.mark.parametrize(
    ("topic", "payload", "more", "why"),
    [
        (SET, b"on", {}, "neither ON nor OFF"),
        (SET, b"ON", {"retain": True}, "retain flag"),
        (SET, b"ON", {"at": 1.0}, "stale_link"),
        ("wisco/bridge/rule/attic/set", b"ON", {}, "there is no such rule"),
    ],
)
def test_what_must_not_switch_a_rule_is_named_in_the_log(
    world: World,
    caplog: pytest.LogCaptureFixture,
    topic: str,
    payload: bytes,
    more: dict[str, object],
    why: str,
) -> None:
    """Retained, old, unreadable, or for a rule that is not there."""
    world.receive(topic, payload, **more)
    assert ("stairs", True) not in world.switched
    [record] = caplog.records
    assert record.levelno == logging.WARNING
    assert why in record.message


def test_a_retained_switch_that_is_cleared_is_no_command(world: World) -> None:
    """And nothing is said of it."""
    world.receive(SET, b"", retain=True)
    assert world.switched == []


def test_what_a_rule_does_is_published(world: World) -> None:
    """Its state is retained; its events are not, like presses."""
    world.publisher.publish(RuleSwitched("stairs", False))
    world.publisher.publish(RuleFired("stairs"))
    world.publisher.publish(RuleFired("stairs", "garage/di/6 is ON"))
    told = {(m.topic.rsplit("/", 1)[1], m.payload, m.retain, m.qos) for m in world.pumped()}
    assert told == {
        ("state", b"OFF", True, 1),
        ("event", b'{"event_type":"fired"}', False, 0),
        ("event", b'{"event_type":"held","detail":"garage/di/6 is ON"}', False, 0),
    }


@pytest.mark.warns
def test_a_refusal_of_an_order_of_a_rule_is_logged_with_its_name(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    """As that of a command; orders of `max_on` are logged by their line."""
    verdict = Verdict("garage", "do/1", "ON", Status.REFUSED, 12, Reason.INTERLOCK)
    world.publisher.publish(replace(verdict, by="rule Stairs"))
    world.publisher.publish(replace(verdict, by="max_on"))
    assert caplog.messages == ["garage do/1 'ON' by rule Stairs: refused: interlock"]


def test_a_broker_without_wildcards_hands_over_its_switch() -> None:
    """The topic of each rule is subscribed."""
    config = replace(CONFIG, rules=(STAIRS,))
    plain = plain_subscriptions(config, Topics("wisco"), ())
    assert SET in [one.topic_filter for one in plain]
