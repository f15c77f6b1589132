from dataclasses import replace

import pytest
from paho.mqtt.client import topic_matches_sub
from support.covers import with_cover
from support.mqtt_side import CONFIG, GARAGE

from bridge.config.schema import CountConfig, InputConfig
from bridge.mqtt.announce.leftovers import Leftovers
from bridge.mqtt.topics import Topics

SNAPSHOT = b'{"di":{},"do":{"1":"ON"}}'
# Everything that a station "old" and a line "loft" leave behind, and channels left out by now.
OURS = {
    "wisco/bridge/line/loft/availability": b"offline",
    "wisco/bridge/rule/stairs/state": b"ON",
    "wisco/bridge/line/loft/diagnostics": b'{"cycle_ms": {"p50": 20}}',
    "wisco/old": SNAPSHOT,
    "wisco/old/availability": b"offline",
    "wisco/old/problem": b'{"state":"OFF"}',
    "wisco/old/own_actions": b'{"last":"do/1 OFF by max_on","actions":[]}',
    "wisco/old/diagnostics": b'{"poll_ms": {"p50": 20}}',
    "wisco/old/di/1": b"OFF",
    "wisco/old/di/16": b"ON",
    "wisco/old/di/16/count": b"12",
    "wisco/old/do/1": b"ON",
    "wisco/old/do/1/mode": b"latch",
    "wisco/old/do/1/hold": b"0.5",
    "wisco/old/cover/roof/state": b"closed",
    "wisco/garage/cover/old-one/state": b"stopped",
    "wisco/garage/cover/old-two/state": b"None",
    "wisco/garage/cover/old-one/position": b"100",
    "wisco/garage/do/3": b"ON",
    "wisco/garage/do/3/mode": b"pulse",
    "wisco/garage/di/2": b"OFF",
    "wisco/garage/di/16/count": b"7",
}
CONFIGURED = {
    "wisco/bridge/state": b"online",
    "wisco/bridge/info": b"{}",
    "wisco/bridge/line/main/availability": b"online",
    "wisco/bridge/line/main/diagnostics": b'{"cycle_ms": {}}',
    "wisco/garage": SNAPSHOT,
    "wisco/garage/availability": b"online",
    "wisco/garage/problem": b'{"state":"OFF"}',
    "wisco/garage/own_actions": b'{"last":"do/1 OFF by max_on","actions":[]}',
    "wisco/garage/di/1": b"ON",
    "wisco/garage/do/4": b"ON",
    "wisco/garage/do/4/hold": b"1.0",
    "wisco/garage/cover/shutter/state": b"open",
    "wisco/garage/cover/shutter/position": b"100",
}


def test_a_count_is_kept_as_long_as_its_input_is_counted() -> None:
    """An input that is there and not counted any more keeps its state alone."""
    counted = InputConfig(16, count=CountConfig())
    garage = replace(GARAGE, inputs=(InputConfig(1), counted))
    config = replace(CONFIG, lines=(replace(CONFIG.lines[0], stations=(garage,)),))
    topics = ["wisco/garage/di/1/count", "wisco/garage/di/16/count", "wisco/garage/di/16"]
    rules = Leftovers(config)
    assert [topic for topic in topics if rules.concerns(topic)] == topics[:1]
    assert rules.among(dict.fromkeys(topics, b"7")) == topics[:1]


def leftovers_of(retained: dict[str, bytes], base: str = "wisco") -> list[str]:
    """Return what a bridge with the stations of CONFIG would clear, in a session."""
    rules = Leftovers(with_cover(replace(CONFIG, mqtt=replace(CONFIG.mqtt, base_topic=base))))
    seen = {topic: payload for topic, payload in retained.items() if rules.concerns(topic)}
    return rules.among(seen)


def test_all_of_a_station_that_is_gone_is_left_over() -> None:
    """Topics of removed stations, lines and channels are left over, and no others."""
    assert sorted(leftovers_of({**OURS, **CONFIGURED})) == sorted(OURS)


def test_every_topic_of_ours_is_listened_for() -> None:
    """The filters of the look cover all that can be left over."""
    filters = [one.topic_filter for one in Leftovers(CONFIG).subscriptions()]
    assert [t for t in OURS if not any(topic_matches_sub(one, t) for one in filters)] == []


@pytest.mark.parametrize("base", ["wisco", "a/b"])
def test_no_command_is_heard_twice(base: str) -> None:
    """No filter of the look matches what the bridge listens to anyway: ON twice is two pulses."""
    config = replace(CONFIG, mqtt=replace(CONFIG.mqtt, base_topic=base))
    filters = [one.topic_filter for one in Leftovers(config).subscriptions()]
    heard = [
        topic.replace("+", name)
        for topic in (one.topic_filter for one in Topics(base).subscriptions("ha/status"))
        for name in ("garage", "1", "di", "do", "bridge", "line")
    ]
    for one in filters:
        assert not any(topic_matches_sub(one, topic) for topic in heard)


@pytest.mark.parametrize(
    ("topic", "payload"),
    [
        ("wisco/old/do/1/set", b"ON"),
        ("wisco/old/set", b'{"do":{"1":"ON"}}'),
        ("wisco/old/result", b'{"status":"done"}'),
        ("wisco/old/di/1/event", b'{"event_type":"short"}'),
        ("wisco/old/notes", b"call the electrician"),
        ("wisco/old/do/01", b"ON"),
        ("wisco/old/do/x", b"ON"),
        ("wisco/old/do/100", b"ON"),
        ("wisco/old/do/1/mode/set", b"pulse"),
        ("wisco/old/cover/roof/set", b"OPEN"),
        ("wisco/old/cover/roof/position/set", b"50"),
        ("wisco/old/cover/Roof/state", b"open"),
        ("wisco/old/cover/roof/state", b"half open"),
        ("wisco/old/cover/roof/position", b"half"),
        ("wisco/Old/availability", b"offline"),
        ("wisco/o__d/availability", b"offline"),
        ("wisco//availability", b"offline"),
        ("wisco/bridge/log", b"{}"),
        ("wisco/bridge", SNAPSHOT),
        ("wisco/bridge/availability", b"offline"),
        ("wisco", SNAPSHOT),
        ("wisco2/old/availability", b"offline"),
        ("wisco__x/old/availability", b"offline"),
        ("elsewhere/old/availability", b"offline"),
        # A topic of our form with words that we never write.
        ("wisco/old", b"bought in 2019"),
        ("wisco/old", b'{"di":{},"do":{},"room":1}'),
        ("wisco/old", b"[1]"),
        ("wisco/old", b"\xff"),
        ("wisco/old/availability", b"maybe"),
        ("wisco/old/problem", b"none"),
        ("wisco/old/diagnostics", b"fine"),
        ("wisco/old/do/1", b"on"),
        ("wisco/old/do/1/mode", b"slow"),
        ("wisco/old/do/1/hold", b"long"),
        ("wisco/old/di/1/count", b"many"),
    ],
)
def test_what_is_not_of_our_form_is_left_alone(topic: str, payload: bytes) -> None:
    """Commands, other people's topics and words, and other bridges' topics are never cleared."""
    assert leftovers_of({topic: payload}) == []


@pytest.mark.parametrize(
    ("base", "station_id"),
    [("wisco/old", "do"), ("wisco/old", "availability"), ("wisco/bridge/line", "loft")],
)
def test_a_bridge_below_our_base_topic_keeps_its_topics(base: str, station_id: str) -> None:
    """Topics at or below the base topic of another bridge are kept."""
    topics = {f"{base}/{station_id}": SNAPSHOT, f"{base}/{station_id}/availability": b"online"}
    theirs = {**topics, f"{base}/do/1": b"ON", f"{base}/availability": b"online"}
    assert leftovers_of({**theirs, f"{base}/bridge/state": b"online"}) == []
    assert leftovers_of(theirs) != []  # the mark is what makes the difference


def test_a_base_topic_of_two_levels() -> None:
    """With a base topic of two levels, topics above and beside it are kept."""
    retained = {
        "a/b/old/availability": b"offline",
        "a/old/availability": b"offline",
        "a/bc/availability": b"offline",
    }
    assert leftovers_of(retained, "a/b") == ["a/b/old/availability"]
