"""Commands through a session: taken, refused, or over a link that is not proven."""

import json
import logging

import pytest
from support.live_session import LAMP, LiveSession

from bridge.bounded_log import BURST_LINES

pytestmark = pytest.mark.warns  # what goes wrong here is logged


@pytest.fixture
def world() -> LiveSession:
    """A session without a connection."""
    return LiveSession()


@pytest.fixture
def live() -> LiveSession:
    """A session that is connected and has told everything."""
    return LiveSession.connected()


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
