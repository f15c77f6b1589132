from hypothesis import given, settings
from hypothesis import strategies as st
from support.links import answer_ping, prove

from bridge.mqtt.link import PING_INTERVAL_S, SETTLING_S, STALE_AFTER_S, LinkCheck


def test_nothing_is_fresh_without_a_connection() -> None:
    """Before the first connect, and after a cut, whatever arrives is stale; no ping is due."""
    link = LinkCheck("run")
    assert link.stale(0.0)
    assert link.ping(0.0) is None
    prove(link, 1.0)
    assert not link.stale(1.0)
    payload = link.ping(2.0)
    link.disconnected()
    link.seen(payload or b"", 2.0)
    assert link.stale(2.0)


def test_a_connection_is_stale_until_its_first_ping_came_back() -> None:
    """Connect at 10 s, first ping back at 11 s: commands are taken from 11.5 s on.

    A broker may deliver what it stored as if it were new, right behind the subscription.
    """
    link = LinkCheck("run")
    link.connected(10.0)
    ping = link.ping(10.0) or b""
    assert link.stale(10.9)
    link.seen(ping, 11.0)
    assert link.stale(11.0)
    assert link.stale(11.0 + SETTLING_S - 0.01)
    assert not link.stale(11.0 + SETTLING_S)


def test_a_ping_of_an_earlier_connection_proves_nothing() -> None:
    """A ping that was sent before the connection was lost comes back after the next connect."""
    link = LinkCheck("run")
    prove(link, 0.0)
    old = link.ping(1.0) or b""
    link.connected(1.5)
    link.seen(old, 1.6)
    assert link.stale(3.0)
    assert link.away(3.0)


def test_the_broker_is_away_until_a_ping_comes_back() -> None:
    """A broker that takes every connection and is mute is away all the time (F6)."""
    link = LinkCheck("run")
    assert link.away(0.0)
    for second in range(30):
        if second % 5 == 0:
            link.connected(float(second))
        link.ping(float(second))
        assert link.away(float(second))
    link.seen(link.ping(30.0) or b"", 30.1)
    assert not link.away(30.1)
    assert link.away(33.1)


def test_a_mute_broker_is_told_from_one_that_is_not_connected() -> None:
    """Mute: connected, and no ping came back for 3 s."""
    link = LinkCheck("run")
    assert not link.mute(100.0)
    link.connected(100.0)
    link.ping(100.0)
    assert not link.mute(103.0)
    assert link.mute(103.01)
    link.disconnected()
    assert not link.mute(200.0)


def test_a_suspend_makes_the_link_stale() -> None:
    """The clock goes on while the machine sleeps: what waited meanwhile is stale (F7)."""
    link = LinkCheck("run")
    prove(link, 10.0)
    assert link.stale(25.0)
    old = link.ping(25.0) or b""
    link.seen(old, 25.1)
    assert not link.stale(25.1)


def test_pings_each_second() -> None:
    """A ping is due at once and then each second, each of its own."""
    link = LinkCheck("run")
    link.connected(10.0)
    pings = [link.ping(at) for at in (10.0, 10.5, 11.0, 11.5, 12.4, 13.3, 13.4)]
    assert [ping is not None for ping in pings] == [True, False, True, False, True, False, True]
    assert len({ping for ping in pings if ping}) == 4


def test_an_answered_link_is_fresh() -> None:
    """While pings come back nothing is stale."""
    link = LinkCheck("run")
    prove(link, 0.0)
    for second in range(1, 20):
        answer_ping(link, float(second))
        assert not link.stale(second + 0.99)


def test_the_oldest_unanswered_ping_is_never_older_than_3_s() -> None:
    """The link is stale while a ping waits for over 3 s, until a young one comes back."""
    link = LinkCheck("run")
    prove(link, 0.0)
    unanswered = [link.ping(float(second)) for second in (1, 2, 3, 4)]
    assert link.stale(4.01)
    link.seen(unanswered[0] or b"", 4.01)
    assert link.stale(4.01)
    link.seen(unanswered[3] or b"", 4.01)
    assert not link.stale(4.01)


def test_a_late_answer_does_not_make_an_early_one_forgotten() -> None:
    """Pings that come back out of order count by the newest."""
    link = LinkCheck("run")
    link.connected(0.0)
    first, second = link.ping(0.0), link.ping(1.0)
    link.seen(second or b"", 1.0)
    link.seen(first or b"", 1.1)
    assert not link.stale(4.0)


def test_pings_of_others_prove_nothing() -> None:
    """Another bridge's ping, an old one, or noise is not an answer."""
    ours, theirs = LinkCheck("ours"), LinkCheck("theirs")
    for link in (ours, theirs):
        link.connected(0.0)
    old = ours.ping(0.0) or b""
    ours.connected(2.0)
    ours.ping(4.0)
    for payload in (old, theirs.ping(4.0) or b"", b"", b"ours 99", b"\xff"):
        ours.seen(payload, 4.0)
    assert ours.stale(5.01)


Spans = list[tuple[float, float]]


def _through(stalls: Spans, at: float) -> float:
    """Return when something leaves a first-in first-out link that it enters at `at`."""
    for begin, end in stalls:
        if begin <= at < end:
            at = end
    return at


def _instants(pauses: list[float]) -> list[float]:
    """Return when the main thread sends pings, over a minute and a half."""
    instants = [0.0]
    while instants[-1] < 90.0:
        instants.append(instants[-1] + PING_INTERVAL_S + pauses[len(instants) % len(pauses)])
    return instants


def _ages(uplink: Spans, downlink: Spans, pings: list[float], commands: list[float]) -> list[float]:
    """Return the age of the accepted commands at their arrival."""
    taken = [(_through(uplink, at), "ping", at) for at in pings]
    taken += [(at, "command", at) for at in commands]
    # Sorted: the broker hands on first what it took first. Sending comes before arriving.
    arrivals = [(_through(downlink, at), 1, at, what, sent) for at, what, sent in sorted(taken)]
    events = sorted([(at, 0, at, "send", at) for at in pings] + arrivals)
    link, payloads, ages = LinkCheck("run"), {}, []
    link.connected(0.0)
    for now, _, at, what, sent in events:
        if what == "send":
            payloads[sent] = link.ping(now) or b""
        elif what == "ping":
            link.seen(payloads[sent], now)
        elif not link.stale(now):
            ages.append(now - at)
    return ages


_spans = st.lists(st.tuples(st.floats(0, 60), st.floats(0.1, 40)), max_size=4).map(
    lambda spans: sorted((begin, begin + length) for begin, length in spans)
)


@settings(max_examples=300)
@given(
    uplink=_spans,
    downlink=_spans,
    pauses=st.lists(st.sampled_from([0.0, 0.0, 0.0, 0.1, 0.7, 8.0]), min_size=1, max_size=9),
    commands=st.lists(st.floats(0, 80), min_size=1, max_size=30),
)
def test_no_old_command_is_accepted(
    uplink: Spans, downlink: Spans, pauses: list[float], commands: list[float]
) -> None:
    """With any delays in both directions, accepted commands are at most 3 s old."""
    ages = _ages(uplink, downlink, _instants(pauses), commands)
    assert all(age <= STALE_AFTER_S for age in ages)


def test_commands_of_a_stall_are_refused_and_later_ones_taken() -> None:
    """After a stall of 25 s what waited in it is refused, and the link recovers by itself."""
    stall = [(10.0, 35.0)]
    pings = _instants([0.0])
    assert _ages(stall, stall, pings, [11.0, 20.0, 31.9]) == []
    assert _ages(stall, stall, pings, [9.5, 36.5, 50.0]) == [0.0, 0.0, 0.0]
