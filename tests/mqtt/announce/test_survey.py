from bridge.mqtt.announce.survey import MOST_BYTES, Survey
from bridge.mqtt.events import Received


def _retained(topic: str, payload: bytes) -> Received:
    return Received(topic, payload, retain=True, at=0.0)


def test_what_is_kept_is_bounded_in_bytes() -> None:
    """A stranger who fills our topics on the broker fills not our memory, and nothing is judged."""
    survey = Survey(lambda _topic: True, {}, 0.0)
    survey.answered(0.0)
    for n in range(100):
        survey.receive(_retained(f"t{n}", b"x" * 256_000), 0.0)
    kept = sum(len(topic) + len(payload) for topic, payload in survey.retained.items())
    assert MOST_BYTES - 256_100 < kept <= MOST_BYTES
    assert not survey.is_whole


def test_what_is_just_as_we_would_publish_it_is_not_kept_twice() -> None:
    """A large house finds all of its own announcements."""
    ours = {f"t{n}": b"x" * 256_000 for n in range(100)}
    survey = Survey(lambda _topic: True, ours, 0.0)
    survey.answered(0.0)
    for topic, payload in ours.items():
        survey.receive(_retained(topic, bytes(bytearray(payload))), 0.0)
    assert survey.retained == ours
    assert all(survey.retained[topic] is ours[topic] for topic in ours)
    assert survey.is_whole


def test_what_is_of_no_concern_costs_nothing() -> None:
    """The topic decides, before the payload is kept."""
    survey = Survey(lambda topic: topic == "mine", {}, 0.0)
    survey.answered(0.0)
    for n in range(100):
        survey.receive(_retained(f"t{n}", b"x" * 256_000), 0.0)
    survey.receive(_retained("mine", b"1"), 0.0)
    assert survey.retained == {"mine": b"1"}
    assert survey.is_whole
