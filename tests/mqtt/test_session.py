import json
import logging
from dataclasses import replace
from typing import Any

import pytest
from support.mqtt_side import CONFIG
from support.world import World

from bridge.bounded_log import BURST_LINES
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
from bridge.mqtt.announce.survey import QUIET_S
from bridge.mqtt.events import (
    Connected,
    Disconnected,
    OutMessage,
    Received,
    Subscribed,
)
from bridge.mqtt.link import SETTLING_S
from bridge.mqtt.log_handler import LogLine
from bridge.mqtt.outbox import WINDOW

pytestmark = pytest.mark.warns  # what goes wrong here is logged

DISCOVERY = [message.topic for message in discovery_messages(CONFIG)]
LAMP = "wisco/garage/do/1/set"
ACCESS_PROBES = tuple(
    f"wisco/bridge/{rest}"
    for rest in (
        "do/bridge/set",
        "set",
        "do/bridge/mode/set",
        "do/bridge/hold/set",
        "cover/bridge/set",
        "cover/bridge/position/set",
        "rule/bridge/set",
        "request/bridge",
    )
)
PROBES = ("wisco/bridge/ping", *ACCESS_PROBES)


class LiveSession(World):
    """A session between a hub that notes and a broker that takes all."""

    def connect(self, protocol: str = "5") -> None:
        """The broker took us, retains nothing of ours, and has said so by now."""
        at = self.now - QUIET_S - SETTLING_S
        self.connection.up = True
        self.session.handle(Connected(protocol, at), at)
        self.session.tick(at)
        pings = [m.payload for m in self.connection.sent if m.topic == PROBES[0]]
        self.session.handle(Received(PROBES[0], pings[-1], retain=False, at=at), at)
        self.session.handle(Subscribed(()), at)

    def cut(self) -> None:
        """The connection ends; what was under way is lost."""
        self.connection.up = False
        self.connection.unacknowledged.clear()
        self.session.handle(Disconnected("test", self.now), self.now)

    def sent(self) -> list[OutMessage]:
        """Let the broker take and acknowledge all that is due; return it without probes."""
        return [m for m in self.settled() if m.topic not in PROBES]

    def topics(self) -> list[str]:
        """The same as topics."""
        return [message.topic for message in self.sent()]

    def verdict(self) -> Any:
        """The one message that went out, which must be a verdict of the garage."""
        [message] = self.sent()
        assert message.topic == "wisco/garage/result"
        return json.loads(message.payload)

    def pass_time(self, seconds: float, *, answer: bool = True, lost: tuple[str, ...] = ()) -> None:
        """Lets time pass in steps of 0.1 s; probes come back if `answer`, but not those `lost`."""
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            before = len(self.connection.sent)
            self.session.tick(self.now)
            for message in self.connection.sent[before:]:
                if answer and message.topic in PROBES and message.topic not in lost:
                    self.receive(message.topic, message.payload)


@pytest.fixture
def world() -> LiveSession:
    """A session without a connection."""
    return LiveSession()


@pytest.fixture
def live(world: LiveSession) -> LiveSession:
    """A session that is connected and has told everything."""
    world.connect()
    world.sent()
    for topic in ACCESS_PROBES:
        world.receive(topic, b"probe")
    return world


# --- connect -----------------------------------------------------------------------------------


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


# --- commands ----------------------------------------------------------------------------------


def test_a_command_is_handed_on(live: LiveSession) -> None:
    """A good command goes to the hub with the instant of its arrival, and nothing is said."""
    live.receive(LAMP, b'{"state": "ON", "id": "x"}', at=live.now - 0.2)
    live.receive("wisco/garage/set", b'{"do": {"4": "ON"}}')
    assert [(c.station_id, c.target, c.mask) for c in live.submitted] == [
        ("garage", "do/1", 1),
        ("garage", "do", 8),
    ]
    assert live.submitted[0].arrived == -0.2
    assert live.sent() == []


@pytest.mark.parametrize(
    ("topic", "payload", "reason"),
    [
        (LAMP, b"on", "bad_payload"),
        (LAMP, b"", "bad_payload"),
        (LAMP, b"\xff\x00", "bad_payload"),
        ("wisco/garage/do/3/set", b"ON", "no_such_channel"),
        ("wisco/garage/do/01/set", b"ON", "no_such_channel"),
        ("wisco/garage/set", b'{"do": {"3": "ON"}}', "no_such_channel"),
    ],
)
def test_a_bad_command_is_refused(
    live: LiveSession, topic: str, payload: bytes, reason: str
) -> None:
    """Exactly one verdict answers a command that cannot be taken; the hub hears nothing."""
    live.now += 0.25
    live.receive(topic, payload, at=live.now - 0.2)
    verdict = live.verdict()
    assert (verdict["status"], verdict["reason"], verdict["ms"]) == ("refused", reason, 200)
    assert verdict["target"] == topic.removeprefix("wisco/garage/").removesuffix("/set").replace(
        "set", "do"
    )
    assert live.submitted == []


@pytest.mark.parametrize(
    ("payload", "shown"),
    [(b'{"state": "ON", "id": "x1"}', "ON"), (b'{"id": "x1"}', '{"id": "x1"}')],
)
def test_a_retained_command_is_refused(live: LiveSession, payload: bytes, shown: str) -> None:
    """A retained command is `retained` whatever it says, and keeps its id."""
    live.receive(LAMP, payload, retain=True)
    verdict = live.verdict()
    assert (verdict["reason"], verdict["id"], verdict["payload"]) == ("retained", "x1", shown)
    assert live.submitted == []


def test_clearing_a_retained_command_is_no_command(live: LiveSession) -> None:
    """An empty retained message on a command topic is somebody tidying up."""
    live.receive(LAMP, b"", retain=True)
    assert live.sent() == []


def test_commands_over_a_stale_link_are_refused(
    live: LiveSession, caplog: pytest.LogCaptureFixture
) -> None:
    """While pings do not come back commands are refused; the log says so once, and its end."""
    caplog.set_level(logging.INFO)
    live.pass_time(2.0)
    live.pass_time(10.0, answer=False)
    live.receive(LAMP)
    verdict = live.verdict()
    assert (verdict["status"], verdict["reason"], verdict["payload"]) == (
        "refused",
        "stale_link",
        "ON",
    )
    live.pass_time(2.0)
    live.receive(LAMP)
    assert len(live.submitted) == 1
    about_link = [record for record in caplog.records if record.name == "bridge.mqtt.session"]
    assert [record.levelname for record in about_link] == ["WARNING", "INFO"]
    assert "wisco/bridge/ping" in caplog.text


def test_another_server_is_asked_for_when_no_ping_comes_back(live: LiveSession) -> None:
    """It is asked for 7 s after pings were missed for 3 s, then each minute, and not before."""
    live.pass_time(20.0)
    assert not live.left_at
    began = live.now
    live.pass_time(75.0, answer=False)
    first, second = live.left_at
    assert 9 <= first - began <= 10
    assert second - first == pytest.approx(60, abs=0.2)


@pytest.mark.parametrize("lost", [True, False])
def test_a_broker_that_loses_acknowledgements_is_connected_anew(
    live: LiveSession, lost: bool
) -> None:
    """Pings come back for 30 s, and one message has no acknowledgement: the window may be shut."""
    live.pass_time(2.0)
    live.receive(LAMP, retain=True)
    live.session.tick(live.now)
    if not lost:
        live.sent()
    live.pass_time(29.0)
    assert not live.connection.renewed
    live.pass_time(3.0)
    assert bool(live.connection.renewed) is lost


def test_a_broker_that_stands_still_is_not_connected_anew(live: LiveSession) -> None:
    """For a minute neither pings nor acknowledgements come; what comes then, comes in order."""
    live.pass_time(2.0)
    live.receive(LAMP, retain=True)
    live.pass_time(60.0, answer=False)
    assert not live.connection.renewed


def test_the_link_is_judged_as_of_the_arrival(live: LiveSession) -> None:
    """A command that waited in our own queue is not refused for the time it spent there."""
    live.pass_time(1.0)
    arrived = live.now
    live.now += 30.0
    live.receive(LAMP, at=arrived)
    assert len(live.submitted) == 1


def test_a_command_before_the_connect_is_known_is_refused(world: LiveSession) -> None:
    """What arrives before the connection is known to be fresh is not carried out."""
    world.receive(LAMP)
    world.connect()
    assert world.submitted == []
    [refusal] = [m for m in world.sent() if m.topic == "wisco/garage/result"]
    assert json.loads(refusal.payload)["reason"] == "stale_link"


def test_commands_are_refused_while_stopping(live: LiveSession) -> None:
    """From the moment that we begin to stop, commands are `stopping`."""
    live.session.stopping()
    live.receive(LAMP)
    assert live.verdict()["reason"] == "stopping"


def test_a_refusal_goes_to_the_response_topic_too(live: LiveSession) -> None:
    """A requester hears of a refusal where it asked to."""
    live.receive(LAMP, b"?", response_topic="me/replies", correlation=b"7")
    result, reply = live.sent()
    assert (reply.topic, reply.correlation, reply.payload) == ("me/replies", b"7", result.payload)


@pytest.mark.parametrize("topic", ["wisco/nobody/do/1/set", "wisco/bridge/set"])
def test_an_unknown_station_is_warned_about(
    live: LiveSession, caplog: pytest.LogCaptureFixture, topic: str
) -> None:
    """A command to no station gets no verdict but a warning that names it."""
    station_id = topic.split("/")[1]
    live.receive(topic)
    assert [getattr(record, "station", None) for record in caplog.records] == [station_id]
    assert station_id in caplog.text
    assert all(message.topic != f"wisco/{station_id}/result" for message in live.sent())


def test_many_unknown_stations_do_not_fill_the_log(
    live: LiveSession, caplog: pytest.LogCaptureFixture
) -> None:
    """A flood of unknown stations is warned about a few times, with names of bearable length."""
    for number in range(1000):
        live.receive(f"wisco/{number}{'x' * 1000}/set")
    assert len(caplog.records) == BURST_LINES
    assert all(len(record.getMessage()) < 100 for record in caplog.records)


def test_at_debug_each_message_is_logged(
    live: LiveSession, caplog: pytest.LogCaptureFixture
) -> None:
    """With its topic and the begin of its payload."""
    caplog.set_level(logging.DEBUG, "bridge.mqtt.session")
    live.receive(LAMP, b"O" * 1000)
    [message] = [text for text in caplog.messages if text.startswith("taken")]
    assert message.startswith(f"taken {LAMP}: b'OOO")
    assert len(message) < 300


@pytest.mark.parametrize(
    ("topic", "payload"),
    [
        ("wisco/garage/do/1", b"online"),
        ("elsewhere", b"online"),
        ("wisco/bridge/state", b"online"),
        ("homeassistant/status", b"offline"),
    ],
)
def test_other_messages_mean_nothing(live: LiveSession, topic: str, payload: bytes) -> None:
    """What is neither a command nor a sign of ours or Home Assistant's is passed over."""
    live.receive(topic, payload)
    live.pass_time(3.0)
    assert live.sent() == []
    assert live.submitted == []


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


# --- what an access list keeps from us ----------------------------------------------------------


def test_a_command_filter_that_gets_nothing_is_named_once(
    live: LiveSession, caplog: pytest.LogCaptureFixture
) -> None:
    """Pings come back and a probe does not: the log says which filter, and only once."""
    live.pass_time(180, lost=("wisco/bridge/do/bridge/set",))
    warnings = [r.getMessage() for r in caplog.records if "access list" in r.getMessage()]
    assert len(warnings) == 1
    assert "wisco/+/do/+/set" in warnings[0]
    assert live.submitted == []


def test_probes_that_come_back_say_nothing(
    live: LiveSession, caplog: pytest.LogCaptureFixture
) -> None:
    """A broker that delivers everything gets no complaint, and its probes are no commands."""
    live.pass_time(90)
    assert [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING] == []


def test_a_stale_link_is_not_taken_for_an_access_list(
    live: LiveSession, caplog: pytest.LogCaptureFixture
) -> None:
    """While pings do not come back either, nothing is said about access."""
    live.pass_time(30, answer=False)
    assert not [r for r in caplog.records if "access list" in r.getMessage()]
