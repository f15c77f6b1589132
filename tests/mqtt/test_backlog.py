from bridge.mqtt.backlog import EventQueue
from bridge.mqtt.events import Acknowledged, MqttEvent, Received


def test_messages_weigh_as_much_as_they_hold() -> None:
    """An event counts as one, a message also by its length, until it is taken out."""
    events: EventQueue[MqttEvent] = EventQueue()
    events.put(Acknowledged(1))
    events.put(Received("b/x/set", b"ON", retain=False, at=0.0))
    assert events.backlog() == 2
    events.put(Received("b/x/set", b"x" * 256_000, retain=False, at=0.0, correlation=b"y" * 256))
    assert events.backlog() == 2 + 1 + 1001
    for _ in range(3):
        events.get()
    assert events.backlog() == 0
