from bridge.mqtt.access import LOST_AFTER_S, PROBE_EVERY_S, CommandProbe
from bridge.mqtt.topics import Topics

FILTERS = ("b/+/do/+/set", "b/+/set", "b/bridge/ping")
SEVERAL, ONE = "b/bridge/set", "b/bridge/do/bridge/set"


def _connected(at: float = 100.0) -> CommandProbe:
    probe = CommandProbe(FILTERS, "nonce")
    probe.connected(at)
    return probe


def test_each_filter_with_a_wildcard_gets_a_probe_that_it_matches() -> None:
    """At once, QoS 1, not retained; a filter without wildcards has a probe of its own elsewhere."""
    sent = list(_connected().due(100.0))
    assert [(m.topic, m.payload, m.qos, m.retain) for m in sent] == [
        (ONE, b"nonce", 1, False),
        (SEVERAL, b"nonce", 1, False),
    ]


def test_every_command_filter_of_the_bridge_is_probed_below_its_base() -> None:
    """No filter of commands is forgotten, and no foreign topic is published on."""
    filters = [one.topic_filter for one in Topics("b").subscriptions("homeassistant/status")]
    probe = CommandProbe(filters, "nonce")
    probe.connected(0.0)
    topics = [message.topic for message in probe.due(0.0)]
    assert len(topics) == sum("+" in one for one in filters)
    assert all(topic.startswith("b/bridge/") for topic in topics)


def test_without_a_connection_nothing_is_sent() -> None:
    """A probe that is never sent cannot be missed."""
    probe = CommandProbe(FILTERS, "nonce")
    assert list(probe.due(1e9)) == []
    assert probe.newly_lost(1e9) == []


def test_probes_are_rare() -> None:
    """Probes are sent at each connect and once a minute."""
    probe = _connected(100.0)
    assert len(list(probe.due(100.0))) == 2
    assert list(probe.due(100.0 + PROBE_EVERY_S - 0.1)) == []
    assert len(list(probe.due(100.0 + PROBE_EVERY_S))) == 2
    probe.connected(200.0)
    assert len(list(probe.due(200.0))) == 2


def test_a_lost_probe_is_told_when_it_is_overdue_and_not_again() -> None:
    """Each filter once, whatever comes or does not come in the rounds after."""
    probe = _connected(100.0)
    list(probe.due(100.0))
    assert probe.took(SEVERAL, b"nonce")
    assert probe.newly_lost(100.0 + LOST_AFTER_S - 0.1) == []
    assert probe.newly_lost(100.0 + LOST_AFTER_S) == [(ONE, "b/+/do/+/set")]
    list(probe.due(160.0))
    assert probe.newly_lost(160.0 + LOST_AFTER_S) == [(SEVERAL, "b/+/set")]


def test_one_that_came_back_meanwhile_is_told_anew() -> None:
    """An access list that is mended and broken again is worth a second line."""
    probe = _connected(0.0)
    for at, comes in ((0.0, False), (60.0, True), (120.0, False)):
        list(probe.due(at))
        if comes:
            assert probe.took(ONE, b"nonce")
            assert probe.took(SEVERAL, b"nonce")
        assert len(probe.newly_lost(at + LOST_AFTER_S)) == (0 if comes else 2)


def test_what_was_sent_over_an_earlier_connection_is_not_missed() -> None:
    """A connection that ends before its probes came back says nothing about access."""
    probe = _connected(0.0)
    list(probe.due(0.0))
    probe.connected(4.0)
    assert probe.newly_lost(LOST_AFTER_S) == []


def test_only_our_own_payload_on_a_topic_of_ours_is_a_probe() -> None:
    """Another bridge's probe, and a user's message, are not."""
    probe = _connected()
    assert not probe.took(ONE, b"other")
    assert not probe.took("b/garage/set", b"nonce")
