import json
import logging
from dataclasses import replace
from typing import Any

import pytest
from support.mqtt_side import CONFIG, GARAGE
from support.world import World

from bridge.bounded_log import BURST_LINES
from bridge.config.schema import Config, CountConfig, InputConfig
from bridge.model import (
    CountChanged,
    CoverChanged,
    CoverState,
    ExchangeCounts,
    Gesture,
    GestureMade,
    LineChanged,
    LineMeasured,
    OutputSettings,
    ProblemChanged,
    Reason,
    ReplyTo,
    SettingsRead,
    StationChanged,
    StationMeasured,
    Status,
    ValuesChanged,
    Verdict,
)
from bridge.mqtt.events import OutMessage
from bridge.mqtt.log_handler import LogLine

SETTINGS = OutputSettings(pulse=0b10, hold_ds=(10, 25, 30, 255, 1, 1, 1, 1))


class ConnectedPublisher(World):
    """A publisher whose outbox is connected to a broker that takes everything."""

    def __init__(self, config: Config = CONFIG) -> None:
        super().__init__(config)
        self.outbox.connected([], 0.0)

    def pairs(self) -> list[tuple[str, bytes]]:
        """The same as topics and payloads."""
        return [(message.topic, message.payload) for message in self.pumped()]

    def json_on(self, topic: str) -> Any:
        """The one message that went out, which must be on `topic`."""
        [(where, payload)] = self.pairs()
        assert where == topic
        return json.loads(payload)


@pytest.fixture
def world() -> ConnectedPublisher:
    """A connected publisher."""
    return ConnectedPublisher()


def test_values(world: ConnectedPublisher) -> None:
    """First every channel, then the snapshot; all retained, QoS 1."""
    world.publisher.publish(ValuesChanged("garage", inputs=0x8000, outputs=0b0010))
    sent = world.pumped()
    assert [(m.topic.removeprefix("wisco/"), m.payload) for m in sent] == [
        ("garage/di/1", b"OFF"),
        ("garage/di/16", b"ON"),
        ("garage/do/1", b"OFF"),
        ("garage/do/2", b"ON"),
        ("garage/do/4", b"OFF"),
        ("garage", b'{"di":{"1":"OFF","16":"ON"},"do":{"1":"OFF","2":"ON","4":"OFF"}}'),
    ]
    assert all(m.retain and m.qos == 1 for m in sent)


def test_only_what_changed_goes_out(world: ConnectedPublisher) -> None:
    """After a change: its channel and one snapshot. A channel that is left out is nothing."""
    world.publisher.publish(ValuesChanged("garage", inputs=0, outputs=0))
    world.pumped()
    world.publisher.publish(ValuesChanged("garage", inputs=0, outputs=0b1000))
    assert [topic for topic, _ in world.pairs()] == ["wisco/garage/do/4", "wisco/garage"]
    world.publisher.publish(ValuesChanged("garage", inputs=0b10, outputs=0b1100))
    assert world.pumped() == []


def test_availability(world: ConnectedPublisher) -> None:
    """Lines and stations come and go on their own topics."""
    world.publisher.publish(LineChanged("main", online=True, detail=""))
    world.publisher.publish(StationChanged("garage", online=True, detail=""))
    world.publisher.publish(StationChanged("garage", online=False, detail=""))
    assert world.pairs() == [
        ("wisco/bridge/line/main/availability", b"online"),
        ("wisco/garage/availability", b"offline"),
    ]


def test_settings(world: ConnectedPublisher) -> None:
    """Mode and hold time of each configured output are published as read."""
    world.publisher.publish(SettingsRead("garage", SETTINGS))
    assert world.pairs() == [
        ("wisco/garage/do/1/mode", b"latch"),
        ("wisco/garage/do/1/hold", b"1.0"),
        ("wisco/garage/do/2/mode", b"pulse"),
        ("wisco/garage/do/2/hold", b"2.5"),
        ("wisco/garage/do/4/mode", b"latch"),
        ("wisco/garage/do/4/hold", b"25.5"),
    ]


def test_settings_that_could_not_be_read_are_cleared(world: ConnectedPublisher) -> None:
    """A mode that it is not known is not shown: not even one that an earlier run left behind."""
    world.publisher.publish(SettingsRead("attic", None))
    assert world.pairs() == [("wisco/attic/do/16/mode", b""), ("wisco/attic/do/16/hold", b"")]


def test_a_cover(world: ConnectedPublisher) -> None:
    """Its position goes first: by it Home Assistant tells whether one that stopped is open."""
    world.publisher.publish(CoverChanged("garage", "shutter", CoverState.STOPPED, 40))
    sent = world.pumped()
    assert [(message.topic, message.payload) for message in sent] == [
        ("wisco/garage/cover/shutter/position", b"40"),
        ("wisco/garage/cover/shutter/state", b"stopped"),
    ]
    assert all(message.retain and message.qos == 1 for message in sent)
    world.publisher.publish(CoverChanged("garage", "shutter", CoverState.STOPPED, None))
    assert world.pairs() == [
        ("wisco/garage/cover/shutter/position", b""),
        ("wisco/garage/cover/shutter/state", b"None"),
    ]


def test_a_problem_that_is_over(world: ConnectedPublisher) -> None:
    """Nothing more is said of a problem that is none."""
    world.publisher.publish(ProblemChanged("garage", "wrong_model", "a DO100 answers"))
    world.pumped()
    world.publisher.publish(ProblemChanged("garage", None, ""))
    assert world.json_on("wisco/garage/problem") == {"state": "OFF"}


@pytest.mark.parametrize(
    ("pause", "reason", "seconds"),
    [(False, "settings_differ", 10), (False, "wrong_model", 20), (True, "settings_differ", 20)],
)
def test_since(world: ConnectedPublisher, pause: bool, reason: str, seconds: int) -> None:
    """A new detail leaves `since` as it was; another reason, or a pause, begins anew."""
    world.now = 10.0
    world.publisher.publish(ProblemChanged("garage", "settings_differ", "output 1"))
    world.now = 20.0
    if pause:
        world.publisher.publish(ProblemChanged("garage", None, ""))
    world.pumped()
    world.publisher.publish(ProblemChanged("garage", reason, "output 2"))
    assert world.json_on("wisco/garage/problem") == {
        "state": "ON",
        "reason": reason,
        "detail": "output 2",
        "since": f"2024-05-01T12:00:{seconds}+00:00",
    }


def test_times_are_told_anew_when_the_clock_is_set(world: ConnectedPublisher) -> None:
    """A start at a wrong time: `started` and `since` are right as soon as the clock is set."""
    world.now = 10.0
    world.publisher.bridge_info("5")
    world.publisher.publish(ProblemChanged("garage", "settings_differ", "output 1"))
    world.pumped()
    world.publisher.follow_wall_clock()
    assert world.pumped() == []
    world.wall_moved_s = 86_400.0
    world.publisher.follow_wall_clock()
    told = {topic: json.loads(payload) for topic, payload in world.pairs()}
    assert told["wisco/bridge/info"]["started"] == "2024-05-02T12:00:00+00:00"
    assert told["wisco/garage/problem"]["since"] == "2024-05-02T12:00:10+00:00"
    world.publisher.publish(ProblemChanged("garage", "settings_differ", "output 1"))
    world.publisher.follow_wall_clock()
    assert world.pumped() == []


def test_a_verdict_goes_to_the_result_topic(world: ConnectedPublisher) -> None:
    """A verdict is QoS 1, not retained, and never merged with another."""
    verdict = Verdict("garage", "do/1", "ON", Status.DONE, 41)
    world.publisher.publish(verdict)
    world.publisher.publish(verdict)
    payload = b'{"target":"do/1","payload":"ON","status":"done","ms":41}'
    message = OutMessage("wisco/garage/result", payload, qos=1, retain=False)
    assert world.pumped() == [message, message]


@pytest.mark.parametrize(("correlation", "expected"), [(b"\0\xff", b"\0\xff"), (b"", None)])
def test_a_verdict_goes_also_where_it_was_asked_for(
    world: ConnectedPublisher, correlation: bytes, expected: bytes | None
) -> None:
    """A requester's topic gets the same verdict with the requester's correlation data."""
    reply_to = ReplyTo("me/replies", correlation)
    verdict = Verdict("garage", "do/1", "ON", Status.DONE, 41, reply_to=reply_to)
    world.publisher.publish(verdict)
    result, reply = world.pumped()
    assert result.correlation is None
    assert reply == OutMessage("me/replies", result.payload, 1, False, expected)


def test_what_was_done_without_a_command_is_retained(world: ConnectedPublisher) -> None:
    """The newest first, each with its time on the wall; a command is not among them."""
    world.publisher.publish(Verdict("garage", "do/1", "OFF", Status.DONE, 41, by="max_on"))
    world.publisher.publish(Verdict("garage", "do/1", "ON", Status.DONE, 41))
    failed = Verdict("garage", "do/2", "ON", Status.FAILED, 9, Reason.NO_REPLY, by="on_loss")
    world.publisher.publish(failed)
    told = [m for m in world.pumped() if m.topic == "wisco/garage/own_actions"]
    assert [(m.qos, m.retain) for m in told] == [(1, True)]
    document = json.loads(told[0].payload)
    assert document["last"] == "do/2 ON by on_loss: no reply"
    assert [(one["target"], one["by"]) for one in document["actions"]] == [
        ("do/2", "on_loss"),
        ("do/1", "max_on"),
    ]
    world.wall_moved_s = 86_400.0
    world.publisher.follow_wall_clock()
    [again] = [m for m in world.pumped() if m.topic == "wisco/garage/own_actions"]
    assert json.loads(again.payload)["actions"][0]["at"] != document["actions"][0]["at"]


def test_what_was_done_without_a_command_is_bounded(world: ConnectedPublisher) -> None:
    """The last 20 of a station are kept."""
    for n in range(100):
        world.publisher.publish(Verdict("garage", "do/1", "OFF", Status.DONE, n, by="max_on"))
    payload = next(m.payload for m in world.pumped() if m.topic == "wisco/garage/own_actions")
    assert [one["ms"] for one in json.loads(payload)["actions"]] == [*range(99, 79, -1)]


def test_what_the_bridge_tells_of_itself(world: ConnectedPublisher) -> None:
    """State and info are retained; a log line is not, and does not insist."""
    world.publisher.bridge_info("5")
    world.publisher.bridge_state(True)
    world.publisher.log(LogLine("warning", "hm", station_id="garage"))
    sent = {message.topic: message for message in world.pumped()}
    info, state = sent["wisco/bridge/info"], sent["wisco/bridge/state"]
    assert info.retain
    assert json.loads(info.payload)["started"] == "2024-05-01T12:00:00+00:00"
    assert state == OutMessage("wisco/bridge/state", b"online", 1, True)
    payload = b'{"level":"warning","message":"hm","station":"garage"}'
    assert sent["wisco/bridge/log"] == OutMessage("wisco/bridge/log", payload, 0, False)


def test_what_was_not_told_is_taken_for_offline(world: ConnectedPublisher) -> None:
    """Lines and stations that nobody spoke of are offline; the others stay as they are."""
    world.publisher.publish(LineChanged("main", online=True, detail=""))
    world.publisher.publish(StationChanged("attic", online=True, detail=""))
    world.pumped()
    world.publisher.assume_offline()
    assert world.pairs() == [("wisco/garage/availability", b"offline")]


def test_order(world: ConnectedPublisher) -> None:
    """Availability first, then station by station everything that it has; figures can wait."""
    order = [topic.removeprefix("wisco/") for topic in world.publisher.order()]
    assert order[:3] == [
        "bridge/line/main/availability",
        "garage/availability",
        "attic/availability",
    ]
    assert order[-9:] == [
        "attic/do/16",
        "attic",
        "attic/do/16/mode",
        "attic/do/16/hold",
        "attic/problem",
        "attic/own_actions",
        "bridge/line/main/diagnostics",
        "garage/diagnostics",
        "attic/diagnostics",
    ]
    assert len(order) == len(set(order))
    world.publisher.publish(ValuesChanged("garage", 0, 0))
    world.publisher.publish(SettingsRead("garage", SETTINGS))
    world.publisher.publish(ProblemChanged("garage", None, ""))
    assert {message.topic.removeprefix("wisco/") for message in world.pumped()} <= set(order)


def test_a_gesture_is_told_now_or_never(world: ConnectedPublisher) -> None:
    """Not retained, and not held while the broker is away: a late press means nothing."""
    world.publisher.publish(GestureMade("garage", 1, Gesture.DOUBLE))
    world.publisher.publish(GestureMade("garage", 1, Gesture.DOUBLE))
    [first, second] = world.pumped()
    assert first == second
    assert (first.topic, first.payload) == ("wisco/garage/di/1/event", b'{"event_type":"double"}')
    assert not first.retain
    world.outbox.disconnected(0.0)
    world.publisher.publish(GestureMade("garage", 1, Gesture.SHORT))
    world.outbox.connected([], 0.0)
    assert not [message for message in world.pumped() if message.topic.endswith("/event")]


def test_a_count_is_a_retained_number(world: ConnectedPublisher) -> None:
    """The same again is nothing new; after an outage the latest goes out anew."""
    for edges, news in ((0, [b"0"]), (12, [b"12"]), (12, [])):
        world.publisher.publish(CountChanged("garage", 1, edges))
        sent = world.pumped()
        assert [message.payload for message in sent] == news
        assert all((m.topic, m.qos, m.retain) == (COUNT, 1, True) for m in sent)
    world.outbox.disconnected(0.0)
    world.outbox.connected([], 0.0)
    assert world.pairs() == [(COUNT, b"12")]


def test_the_counts_of_counted_inputs_follow_the_snapshot() -> None:
    """At a connect their place is among the states; of the other inputs there is none."""
    garage = replace(GARAGE, inputs=(InputConfig(1, count=CountConfig()), InputConfig(2)))
    config = replace(CONFIG, lines=(replace(CONFIG.lines[0], stations=(garage,)),))
    world = ConnectedPublisher(config)
    order = list(world.publisher.order())
    assert [topic for topic in order if topic.endswith("/count")] == [COUNT]
    assert order[order.index(COUNT) - 1] == "wisco/garage"
    world.current.replace(CONFIG)
    retired = world.publisher.config_replaced(config)
    assert COUNT in retired


COUNT = "wisco/garage/di/1/count"
COUNTS = ExchangeCounts(good=1, silent=0, bad=0, refused=0)


def test_diagnostics_of_a_line_are_retained_and_fleeting(world: ConnectedPublisher) -> None:
    """The latest figures stay on the broker; nobody waits for their acknowledgement."""
    world.publisher.publish(LineMeasured("main", None, 0.5, COUNTS, 0))
    [message] = world.pumped()
    assert message.topic == "wisco/bridge/line/main/diagnostics"
    assert (message.qos, message.retain) == (0, True)
    assert json.loads(message.payload)["utilisation"] == 0.5


@pytest.mark.parametrize(
    ("last_seen", "told"), [(-90.0, "2024-05-01T11:58:30.000+00:00"), (None, None)]
)
def test_diagnostics_of_a_station_tell_when_it_was_seen(
    world: ConnectedPublisher, last_seen: float | None, told: str | None
) -> None:
    """The instant of the monotonic clock becomes a time on the wall, with its zone."""
    measured = StationMeasured("garage", None, None, 0.1, None, COUNTS, None, last_seen=last_seen)
    world.publisher.publish(measured)
    [message] = world.pumped()
    assert message.topic == "wisco/garage/diagnostics"
    assert (message.qos, message.retain) == (0, True)
    assert json.loads(message.payload)["last_seen"] == told


REFUSED = Verdict(
    "garage", "do/1", "ON", Status.REFUSED, 3, Reason.INTERLOCK, detail="output 2 is ON"
)


def test_a_command_that_was_not_done_is_warned_of(
    world: ConnectedPublisher, caplog: pytest.LogCaptureFixture
) -> None:
    """In words: what was asked, its reason and the detail; what was done says nothing."""
    caplog.set_level(logging.INFO)
    world.publisher.publish(REFUSED)
    world.publisher.publish(Verdict("garage", "do", "x" * 1000, Status.UNKNOWN, 3, Reason.NO_REPLY))
    world.publisher.publish(Verdict("garage", "do/1", "ON", Status.DONE, 3))
    world.publisher.publish(replace(REFUSED, by="max_on"))  # which the line has logged
    told, shortened = caplog.records
    assert told.getMessage() == "garage do/1 'ON': refused: interlock: output 2 is ON"
    assert (told.levelname, getattr(told, "station", None)) == ("WARNING", "garage")
    assert shortened.getMessage().startswith("garage do 'xxxx")
    assert shortened.getMessage().endswith("xxxx: unknown: no_reply")
    assert len(shortened.getMessage()) < 120


def test_refusals_are_bounded_by_station_and_reason(
    world: ConnectedPublisher, caplog: pytest.LogCaptureFixture
) -> None:
    """An automation in circles hides neither another station nor another reason."""
    for _ in range(1000):
        world.publisher.publish(REFUSED)
    assert len(caplog.records) == BURST_LINES
    world.publisher.publish(replace(REFUSED, station_id="attic"))
    world.publisher.publish(replace(REFUSED, reason=Reason.OFFLINE))
    assert len(caplog.records) == BURST_LINES + 2


def test_at_debug_each_verdict_is_logged(
    world: ConnectedPublisher, caplog: pytest.LogCaptureFixture
) -> None:
    """Those of commands that were done too."""
    caplog.set_level(logging.DEBUG)
    world.publisher.publish(Verdict("garage", "do/1", "ON", Status.DONE, 41))
    assert caplog.messages == ["garage do/1 'ON': done (41 ms)"]
