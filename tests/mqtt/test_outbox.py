from hypothesis import given, settings
from hypothesis import strategies as st
from support.mqtt_side import FakeConnection

from bridge.mqtt.events import OutMessage
from bridge.mqtt.outbox import MOST_HELD, Outbox


def _state(topic: str, payload: bytes) -> OutMessage:
    return OutMessage(topic, payload, qos=1, retain=True)


def _verdict(payload: bytes) -> OutMessage:
    return OutMessage("result", payload, qos=1, retain=False)


def _log(payload: bytes) -> OutMessage:
    return OutMessage("log", payload, qos=0, retain=False)


def _figures(payload: bytes) -> OutMessage:
    return OutMessage("diagnostics", payload, qos=0, retain=True)


def _acknowledge_all(outbox: Outbox, connection: FakeConnection) -> None:
    for token in connection.unacknowledged:
        outbox.acknowledged(token)
    connection.unacknowledged.clear()


def _drain(outbox: Outbox, connection: FakeConnection, now: float = 0.0) -> list[bytes]:
    """Pumps and acknowledges until nothing waits; returns the payloads in order."""
    outbox.pump(connection.publish, now)
    while not outbox.idle:
        _acknowledge_all(outbox, connection)
        outbox.pump(connection.publish, now)
    return [message.payload for message in connection.taken()]


def _online(window: int = 64) -> tuple[Outbox, FakeConnection]:
    outbox, connection = Outbox(window), FakeConnection()
    outbox.connected([], 0.0)
    return outbox, connection


def test_a_state_goes_out_once_on_change() -> None:
    """The same value again is not published again, another one is."""
    outbox, connection = _online()
    for payload in (b"ON", b"ON", b"OFF"):
        outbox.put(_state("do/1", payload), 0.0)
        outbox.pump(connection.publish, 0.0)
    outbox.put(_state("do/1", b"OFF"), 0.0)
    outbox.pump(connection.publish, 0.0)
    assert connection.pairs() == [("do/1", b"ON"), ("do/1", b"OFF")]
    assert outbox.latest("do/1") == b"OFF"
    assert outbox.latest("do/2") is None


def test_order_is_kept() -> None:
    """States go out before the verdict that was put after them."""
    outbox, connection = _online()
    for message in (_state("do/1", b"ON"), _state("snapshot", b"{}"), _verdict(b"done")):
        outbox.put(message, 0.0)
    assert _drain(outbox, connection) == [b"ON", b"{}", b"done"]


def test_a_newer_value_takes_the_place_of_one_that_waits() -> None:
    """The newest of several values of a topic is sent, before verdicts on the others."""
    outbox, connection = _online(window=1)
    for payload in (b"a1", b"b1", b"b2"):
        outbox.put(_state(payload[:1].decode(), payload), 0.0)
    outbox.put(_verdict(b"first"), 0.0)
    outbox.put(_state("b", b"b3"), 0.0)
    outbox.put(_verdict(b"second"), 0.0)
    assert _drain(outbox, connection) == [b"a1", b"b3", b"first", b"second"]


def test_no_more_than_a_window_is_unacknowledged() -> None:
    """Each acknowledgement lets one more message out; a strange one lets out nothing."""
    outbox, connection = _online(window=3)
    for number in range(5):
        outbox.put(_state(f"t{number}", b"x"), 0.0)
    outbox.pump(connection.publish, 0.0)
    assert len(connection.taken()) == 3
    outbox.acknowledged(999)
    outbox.pump(connection.publish, 0.0)
    assert connection.taken() == []
    outbox.acknowledged(connection.unacknowledged.pop(0))
    outbox.pump(connection.publish, 0.0)
    assert connection.pairs() == [("t3", b"x")]


def test_nothing_goes_out_offline() -> None:
    """Without a connection nothing is sent, and nothing waits for it."""
    outbox, connection = Outbox(), FakeConnection()
    for message in (_state("a", b"1"), _verdict(b"v"), _log(b"l")):
        outbox.put(message, 0.0)
    outbox.pump(connection.publish, 0.0)
    assert connection.taken() == []
    assert outbox.idle


def test_a_connect_sends_everything_in_order() -> None:
    """At connect: the latest of every topic, those of the order last, then held verdicts."""
    outbox, connection = Outbox(), FakeConnection()
    outbox.put(_verdict(b"verdict"), 0.0)
    for topic in ("bridge", "state", "other", "availability"):
        outbox.put(_state(topic, b"old"), 0.0)
        outbox.put(_state(topic, topic.encode()), 0.0)
    outbox.put(_log(b"lost"), 0.0)
    order = ["availability", "state", "never published", "bridge"]
    outbox.connected(order, 0.0)
    everything = [b"other", b"availability", b"state", b"bridge"]
    assert _drain(outbox, connection) == [*everything, b"verdict"]
    outbox.connected(order, 0.0)
    assert _drain(outbox, connection) == everything


def test_what_a_cut_left_unacknowledged_goes_out_again() -> None:
    """After a cut: states as they are now, and verdicts that may have been lost, in order."""
    outbox, connection = _online(window=2)
    for message in (_state("a", b"1"), _verdict(b"v1"), _verdict(b"v2"), _state("b", b"1")):
        outbox.put(message, 0.0)
    outbox.pump(connection.publish, 0.0)
    assert len(connection.taken()) == 2
    outbox.disconnected(1.0)
    connection.unacknowledged.clear()
    outbox.put(_state("a", b"2"), 1.0)
    outbox.put(_verdict(b"v3"), 1.0)
    outbox.connected(["a"], 2.0)
    assert _drain(outbox, connection, 2.0) == [b"1", b"2", b"v1", b"v2", b"v3"]


def test_a_connection_that_ended_unheard_loses_nothing() -> None:
    """A message that the client did not take stays until it does."""
    outbox, connection = _online()
    outbox.put(_verdict(b"v"), 0.0)
    outbox.put(_state("a", b"1"), 0.0)
    connection.up = False
    outbox.pump(connection.publish, 0.0)
    assert not outbox.idle
    connection.up = True
    assert _drain(outbox, connection) == [b"v", b"1"]


def test_held_verdicts_are_256_at_most() -> None:
    """Offline the oldest verdicts go first, and are counted."""
    outbox, connection = Outbox(), FakeConnection()
    for number in range(MOST_HELD + 10):
        outbox.put(_verdict(b"%d" % number), 0.0)
    assert (outbox.dropped_verdicts, len(outbox)) == (10, 256)
    outbox.connected([], 0.0)
    assert _drain(outbox, connection)[0] == b"10"


def test_held_verdicts_are_60_s_old_at_most() -> None:
    """A verdict that could not be told within a minute is dropped."""
    outbox, connection = Outbox(), FakeConnection()
    outbox.put(_verdict(b"old"), 0.0)
    outbox.put(_verdict(b"young"), 30.0)
    outbox.connected([], 60.5)
    assert _drain(outbox, connection, 60.5) == [b"young"]
    assert outbox.dropped_verdicts == 1


def test_a_flood_of_verdicts_is_told_while_the_broker_is_there() -> None:
    """Connected, ten thousand verdicts at once all go out; at a cut only the bound is kept."""
    outbox, connection = _online()
    for number in range(10_000):
        outbox.put(_verdict(b"%d" % number), 0.0)
    assert len(_drain(outbox, connection)) == 10_000
    for number in range(1000):
        outbox.put(_verdict(b"%d" % number), 0.0)
    outbox.disconnected(0.0)
    assert (len(outbox), outbox.dropped_verdicts) == (256, 744)


def test_clearing_a_topic_forgets_it() -> None:
    """An empty payload goes out, once; acknowledged, the topic takes no memory any more."""
    outbox, connection = _online()
    outbox.put(_state("a", b"1"), 0.0)
    outbox.put(_state("a", b""), 0.0)
    outbox.put(_state("a", b""), 0.0)
    outbox.put(_state("unknown", b""), 0.0)
    assert len(outbox) > 0
    assert _drain(outbox, connection) == [b"", b""]
    assert len(outbox) == 0
    outbox.connected(["a"], 0.0)
    assert _drain(outbox, connection) == []


def test_a_topic_that_was_cleared_can_live_again() -> None:
    """A value that comes while the clearing is under way is kept."""
    outbox, connection = _online()
    outbox.put(_state("a", b""), 0.0)
    outbox.pump(connection.publish, 0.0)
    outbox.put(_state("a", b"1"), 0.0)
    assert _drain(outbox, connection) == [b"", b"1"]
    assert outbox.latest("a") == b"1"


def test_a_clearing_that_was_not_acknowledged_is_repeated() -> None:
    """A topic is cleared although the broker was away when it was to be."""
    outbox, connection = Outbox(), FakeConnection()
    outbox.put(_state("a", b""), 0.0)
    outbox.connected([], 0.0)
    assert _drain(outbox, connection) == [b""]


def test_again_sends_the_latest_values_once_more() -> None:
    """Values can be repeated in a given order; unknown topics and a missing broker are skipped."""
    outbox, connection = _online()
    for topic in ("a", "b"):
        outbox.put(_state(topic, topic.encode()), 0.0)
    _drain(outbox, connection)
    outbox.again(["b", "x", "a"])
    assert _drain(outbox, connection) == [b"b", b"a"]
    outbox.disconnected(0.0)
    outbox.again(["a"])
    assert len(outbox) == 2


def test_a_long_value_is_kept_whole() -> None:
    """An announcement of 20 KB is kept packed: what is sent again, and compared, is as it was."""
    outbox, connection = _online()
    long, other = (word * 4000 for word in (b"first", b"other"))
    outbox.put(_state("config", long), 0.0)
    outbox.put(_state("config", long), 0.0)
    assert _drain(outbox, connection) == [long]
    outbox.put(_state("config", long), 0.0)
    outbox.again(["config"])
    assert _drain(outbox, connection) == [long]
    outbox.put(_state("config", other), 0.0)
    assert outbox.latest("config") == other
    outbox.put(_state("config", b"short"), 0.0)
    assert outbox.latest("config") == b"short"
    outbox.disconnected(0.0)
    outbox.put(_state("config", long), 0.0)
    outbox.connected([], 0.0)
    assert _drain(outbox, connection) == [long]


def test_what_is_only_true_after_the_others_goes_behind_them() -> None:
    """Coming up: an `online` that takes the place of a waiting `offline` follows the states."""
    outbox, connection = _online(window=1)
    for message in (_state("x", b"x"), _state("availability", b"offline"), _state("do/1", b"ON")):
        outbox.put(message, 0.0)
    outbox.put(_state("availability", b"online"), 0.0, at_end=True)
    assert _drain(outbox, connection) == [b"x", b"ON", b"online"]


def test_what_is_repeated_does_not_delay_what_is_new() -> None:
    """While 100 values are repeated a new state and its verdict go out among the first."""
    outbox, connection = _online(window=1)
    topics = [f"t{n}" for n in range(100)]
    for topic in topics:
        outbox.put(_state(topic, topic.encode()), 0.0)
    _drain(outbox, connection)
    outbox.again(topics)
    outbox.put(_state("t99", b"new"), 0.0)
    outbox.put(_verdict(b"done"), 0.0)
    drained = _drain(outbox, connection)
    assert drained.index(b"new") < drained.index(b"done") < 5
    assert [one for one in drained if one.startswith(b"t")] == [t.encode() for t in topics[:99]]
    assert not outbox.repeating


def test_births_without_end_starve_no_topic() -> None:
    """A topic that waits to be repeated keeps its place, however often it is asked for."""
    outbox, connection = _online(window=1)
    for topic in "abcd":
        outbox.put(_state(topic, topic.encode()), 0.0)
    _drain(outbox, connection)
    for _ in range(8):
        outbox.again("abcd")
        outbox.pump(connection.publish, 0.0)
        _acknowledge_all(outbox, connection)
    assert [payload for _, payload in connection.pairs()] == [b"a", b"b", b"c", b"d"] * 2


def test_verdicts_are_bounded_in_bytes() -> None:
    """Waiting verdicts are limited to 8 MiB."""
    outbox, _ = _online(window=1)
    for _ in range(1000):
        outbox.put(OutMessage("reply", b"x" * 65_536, qos=1, retain=False), 0.0)
    assert outbox.dropped_verdicts == 1000 - 127


def test_a_cleared_topic_is_not_repeated() -> None:
    """A topic that is cleared while it waits for its repeat is not repeated."""
    outbox, connection = _online(window=1)
    outbox.put(_state("a", b"1"), 0.0)
    _drain(outbox, connection)
    outbox.again(["a"])
    outbox.put(_state("a", b""), 0.0)
    assert _drain(outbox, connection) == [b""]
    assert not outbox.repeating


def test_fleeting_messages_go_out_now_or_never() -> None:
    """QoS 0 does not wait for the window, nor for another connection, and is bounded."""
    outbox, connection = _online(window=1)
    outbox.put(_state("a", b"1"), 0.0)
    outbox.put(_state("b", b"1"), 0.0)
    for number in range(1000):
        outbox.put(_log(b"%d" % number), 0.0)
    assert len(outbox) < 100
    outbox.pump(connection.publish, 0.0)
    assert [payload for _, payload in connection.pairs()][-2:] == [b"999", b"1"]
    outbox.put(_log(b"too late"), 0.0)
    outbox.disconnected(0.0)
    outbox.connected([], 0.0)
    assert _drain(outbox, connection) == [b"1", b"1"]


class BothEnds:
    """An outbox and a broker between which everything may happen."""

    def __init__(self) -> None:
        self.outbox, self.connection = Outbox(window=2), FakeConnection()
        self.truth: dict[str, bytes] = {}
        self.verdicts: list[bytes] = []
        self.broker: list[OutMessage] = []

    def step(self, what: str, number: int) -> None:
        """Lets one thing happen."""
        outbox, connection = self.outbox, self.connection
        match what:
            case "state":
                topic, payload = f"t{number % 3}", b"%d" % number
                self.truth[topic] = payload
                outbox.put(_state(topic, payload), 0.0)
            case "verdict":
                self.verdicts.append(b"v%d" % len(self.verdicts))
                outbox.put(_verdict(self.verdicts[-1]), 0.0)
            case "pump":
                outbox.pump(connection.publish, 0.0)
            case "acknowledge" if connection.unacknowledged:
                outbox.acknowledged(connection.unacknowledged.pop(0))
            case "die":
                connection.up = False
            case "connect":
                self.connect()
        self.broker += connection.taken()

    def connect(self) -> None:
        """A new connection, of which what the old one had under way knows nothing."""
        self.connection.up = True
        self.connection.unacknowledged.clear()
        self.outbox.connected(["t2", "t1"], 0.0)

    def settle(self) -> None:
        """Lets the broker have everything that waits."""
        self.connect()
        while True:
            self.step("pump", 0)
            if self.outbox.idle:
                return
            self.step("acknowledge", 0)


@settings(max_examples=300)
@given(
    steps=st.lists(
        st.tuples(
            st.sampled_from(["state", "verdict", "pump", "acknowledge", "die", "connect"]),
            st.integers(0, 5),
        ),
        max_size=150,
    )
)
def test_the_broker_ends_up_with_the_truth(steps: list[tuple[str, int]]) -> None:
    """After any connects and losses the broker has the latest values and all verdicts."""
    world = BothEnds()
    for what, number in steps:
        world.step(what, number)
        assert len(world.outbox) <= 2 * len(world.truth) + len(world.verdicts) + 2
    world.settle()
    assert {m.topic: m.payload for m in world.broker if m.retain} == world.truth
    told = dict.fromkeys(m.payload for m in world.broker if not m.retain)
    assert list(told) == world.verdicts


def test_retained_qos_0_is_sent_at_once_and_waits_for_no_acknowledgement() -> None:
    """A retained QoS 0 message is sent at once and takes no place in the window."""
    outbox, connection = _online(window=1)
    for payload in (b"1", b"2"):
        outbox.put(_figures(payload), 0.0)
        outbox.pump(connection.publish, 0.0)
        assert outbox.idle
    assert connection.pairs() == [("diagnostics", b"1"), ("diagnostics", b"2")]


def test_of_retained_qos_0_the_latest_alone_is_kept_and_sent_at_connect() -> None:
    """While the broker is away nothing queues; each connect brings the latest once."""
    outbox, connection = Outbox(), FakeConnection()
    for n in range(1000):
        outbox.put(_figures(b"%d" % n), 0.0)
    assert len(outbox) == 1
    for _ in range(2):
        outbox.connected([], 0.0)
        assert _drain(outbox, connection) == [b"999"]
        outbox.disconnected(0.0)


def test_waiting_retained_qos_0_is_replaced_by_the_newer() -> None:
    """Behind a full window only one value a topic waits."""
    outbox, connection = _online(window=1)
    outbox.put(_state("a", b"a"), 0.0)
    outbox.pump(connection.publish, 0.0)
    for payload in (b"1", b"2"):
        outbox.put(_figures(payload), 0.0)
        outbox.pump(connection.publish, 0.0)
    assert _drain(outbox, connection) == [b"a", b"2"]
