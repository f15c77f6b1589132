"""A session from connect to stop, and the signs of others that it answers."""

import json
from dataclasses import replace

import pytest
from support.live_session import LiveSession
from support.mqtt_side import CONFIG

from bridge.model import (
    ExchangeCounts,
    LineChanged,
    LineMeasured,
    ProblemChanged,
    StationChanged,
    Status,
    ValuesChanged,
    Verdict,
)
from bridge.mqtt.announce.discovery import discovery_messages
from bridge.mqtt.log_handler import LogLine
from bridge.mqtt.outbox import WINDOW

pytestmark = pytest.mark.warns  # what goes wrong here is logged

DISCOVERY = [message.topic for message in discovery_messages(CONFIG)]


@pytest.fixture
def world() -> LiveSession:
    """A session without a connection."""
    return LiveSession()


@pytest.fixture
def live() -> LiveSession:
    """A session that is connected and has told everything."""
    return LiveSession.connected()


def test_the_first_connect(world: LiveSession) -> None:
    """Everything unknown is offline, then info and discovery, and `online` is the last."""
    world.connect()
    sent = world.sent()
    assert [message.topic for message in sent] == [
        "wisco/bridge/line/main/availability",
        "wisco/garage/availability",
        "wisco/attic/availability",
        "wisco/bridge/info",
        *DISCOVERY,
        "wisco/bridge/state",
    ]
    assert [message.payload for message in sent[:3]] == [b"offline"] * 3
    assert sent[-1].payload == b"online"


def test_freed_memory_is_returned_once_all_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """The announcements of a connect were long: after each the heap is trimmed, once."""
    trims: list[float] = []
    monkeypatch.setattr("bridge.daemon.wiring.trim_heap", lambda: trims.append(1.0))
    world = LiveSession()
    for connects in (1, 2):
        world.connect()
        assert len(trims) == connects - 1
        world.sent()
        world.pass_time(1.0)
        assert len(trims) == connects
        world.cut()


def test_a_reconnect_tells_everything_anew(live: LiveSession) -> None:
    """States of now, the verdicts that were held, then devices, and `online` is the last."""
    live.publisher.publish(LineChanged("main", online=True, detail=""))
    live.publisher.publish(ValuesChanged("attic", 0, 0))
    live.sent()
    live.cut()
    live.publisher.publish(ValuesChanged("attic", 0, 0x8000))
    live.publisher.publish(ProblemChanged("attic", None, ""))
    live.publisher.publish(StationChanged("attic", online=True, detail=""))
    live.publisher.publish(Verdict("attic", "do/16", "ON", Status.DONE, 1))
    assert live.sent() == []
    live.connect("3.1.1")
    sent = live.sent()
    assert [message.topic.removeprefix("wisco/") for message in sent] == [
        "bridge/line/main/availability",
        "garage/availability",
        "attic/availability",
        "attic/do/16",
        "attic",
        "attic/problem",
        "bridge/info",
        "attic/result",
        *DISCOVERY,
        "bridge/state",
    ]
    assert [message.payload for message in sent[2:4]] == [b"online", b"ON"]
    assert json.loads(sent[6].payload)["protocol"] == "3.1.1"


def test_a_ping_goes_before_the_burst(world: LiveSession) -> None:
    """Whoever answers our `online` with a command finds a link that was just proven."""
    world.connect()
    world.session.tick(world.now)
    assert world.connection.sent[0].topic == "wisco/bridge/ping"
    assert world.connection.sent[0].qos == 0


def test_lost_verdicts_are_owned_up(world: LiveSession, caplog: pytest.LogCaptureFixture) -> None:
    """How many verdicts could not be held is said once, at the connect."""
    for _ in range(260):
        world.publisher.publish(Verdict("attic", "do/16", "ON", Status.DONE, 1))
    world.connect()
    world.connect()
    assert [record.getMessage() for record in caplog.records] == [
        "4 verdicts were dropped while the broker was away"
    ]


# --- signs -------------------------------------------------------------------------------------


def test_home_assistants_birth_is_answered_once(live: LiveSession) -> None:
    """Two births within the jitter are answered by one discovery and one set of states."""
    live.publisher.publish(ValuesChanged("attic", 0, 0))
    live.sent()
    live.jitter_s = 1.5
    live.receive("homeassistant/status", b"online")
    live.pass_time(1.0)
    live.receive("homeassistant/status", b"online")
    assert live.topics() == []
    live.pass_time(0.6)
    assert [topic.removeprefix("wisco/") for topic in live.topics()] == [
        *DISCOVERY,
        "bridge/line/main/availability",
        "garage/availability",
        "attic/availability",
        "attic/do/16",
        "attic",
        "bridge/state",
    ]
    live.pass_time(5.0)
    assert live.topics() == []


def test_states_are_published_again_as_often_as_the_configuration_says() -> None:
    """`mqtt.repeat`: a client at a node that was cut off is right again, without a change.

    What is online comes after the states: the client may have missed that a module came back.
    """
    live = LiveSession(replace(CONFIG, mqtt=replace(CONFIG.mqtt, repeat_s=5.0)))
    live.connect()
    live.publisher.publish(ValuesChanged("attic", 0, 0))
    live.pass_time(1.0)
    live.sent()
    live.pass_time(3.0)
    assert live.topics() == []
    live.publisher.publish(StationChanged("attic", online=True, detail="DO100"))
    live.publisher.publish(LineMeasured("main", None, 0.5, ExchangeCounts(1, 0, 0, 0), 0))
    live.sent()
    live.pass_time(1.5)
    assert live.topics() == [
        "wisco/bridge/line/main/availability",
        "wisco/garage/availability",
        "wisco/attic/do/16",
        "wisco/attic",
        "wisco/attic/availability",
        "wisco/bridge/state",
    ]
    live.cut()
    live.pass_time(20.0)
    assert live.topics() == []


def test_nothing_is_repeated_once_the_bridge_stops() -> None:
    """The last word is `offline`: a repeat of states would only keep the bridge from its end."""
    live = LiveSession(replace(CONFIG, mqtt=replace(CONFIG.mqtt, repeat_s=5.0)))
    live.connect()
    live.pass_time(1.0)
    live.session.stop(live.now)
    live.sent()
    live.pass_time(6.0)
    assert live.topics() == []


def test_a_birth_during_a_round_asks_for_one_more_after_it(live: LiveSession) -> None:
    """However often Home Assistant is started, one round waits at a time behind the window."""
    live.receive("homeassistant/status", b"online")
    a_round = len(live.topics())
    for _ in range(50):
        live.receive("homeassistant/status", b"online")
        live.session.tick(live.now)
    assert WINDOW <= len(live.topics()) <= WINDOW + 2 * a_round


def test_our_own_will_is_contradicted(live: LiveSession) -> None:
    """`offline` of an earlier connection is answered with `online`, at most once a second."""
    live.receive("wisco/bridge/state", b"offline")
    assert [(m.topic, m.payload, m.retain) for m in live.sent()] == [
        ("wisco/bridge/state", b"online", True)
    ]
    for _ in range(5):
        live.receive("wisco/bridge/state", b"offline")
    live.pass_time(0.9)
    assert live.topics() == []
    live.pass_time(0.2)
    assert live.topics() == ["wisco/bridge/state"]


def test_a_cut_ends_what_was_due(live: LiveSession) -> None:
    """A birth or a will of the old connection is not answered on the new one a second time."""
    live.jitter_s = 1.0
    live.receive("homeassistant/status", b"online")
    live.receive("wisco/bridge/state", b"offline")
    live.cut()
    live.pass_time(2.0)
    live.connect()
    assert live.topics().count("wisco/bridge/state") == 1
    live.pass_time(2.0)
    assert live.topics() == []


def test_log_lines_go_out(live: LiveSession) -> None:
    """Warnings of any thread are published by this one; offline they are let go."""
    live.log_lines.put(LogLine("warning", "hm", line="main"))
    [message] = live.sent()
    told = {"level": "warning", "message": "hm", "line": "main"}
    assert (message.topic, json.loads(message.payload)) == ("wisco/bridge/log", told)
    live.cut()
    live.log_lines.put(LogLine("warning", "nobody hears this"))
    live.session.tick(live.now)
    live.connect()
    assert "wisco/bridge/log" not in live.topics()


def test_a_flood_of_log_lines_takes_turns(live: LiveSession) -> None:
    """However much there is to log, a tick stays short."""
    for _ in range(100):
        live.log_lines.put(LogLine("warning", "hm"))
    assert len(live.sent()) == 10
    assert live.log_lines.qsize() == 90


# --- stop --------------------------------------------------------------------------------------


def test_a_clean_stop(live: LiveSession) -> None:
    """Verdicts that wait, then everything offline; drained when the broker has it all."""
    live.publisher.publish(LineChanged("main", online=True, detail=""))
    live.publisher.publish(StationChanged("garage", online=True, detail=""))
    live.sent()
    live.publisher.publish(Verdict("garage", "do/1", "ON", Status.DONE, 1))
    live.session.stop(live.now)
    assert not live.session.drained
    assert [message.topic for message in live.sent()] == [
        "wisco/garage/result",
        "wisco/bridge/state",
        "wisco/bridge/line/main/availability",
        "wisco/garage/availability",
    ]
    assert live.session.drained
    live.receive("wisco/bridge/state", b"offline")
    assert live.sent() == []


def test_a_reconnect_while_stopping_does_not_say_online(live: LiveSession) -> None:
    """A connection that comes back after the goodbye hears it again."""
    live.session.stop(live.now)
    live.cut()
    live.connect()
    last = live.sent()[-1]
    assert (last.topic, last.payload) == ("wisco/bridge/state", b"offline")


def test_a_stop_without_a_broker_waits_for_nobody(world: LiveSession) -> None:
    """With nobody to tell, there is nothing left to send."""
    world.session.stop(world.now)
    assert world.session.drained
