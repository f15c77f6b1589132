import pytest

from bridge.model import Setting
from bridge.mqtt.topics import CommandTarget, CoverTarget, OwnTopic, RequestTarget, Topics

TOPICS = Topics("house/wisco")


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("house/wisco/garage/do/3/set", CommandTarget("garage", "3")),
        ("house/wisco/garage/do/03/set", CommandTarget("garage", "03")),
        ("house/wisco/garage/do//set", CommandTarget("garage", "")),
        ("house/wisco/garage/set", CommandTarget("garage", None)),
        ("house/wisco/bridge/set", CommandTarget("bridge", None)),
        ("house/wisco/bridge/state", OwnTopic.STATE),
        ("house/wisco/bridge/ping", OwnTopic.PING),
        ("house/wisco/garage", None),
        ("house/wisco/garage/do/3", None),
        ("house/wisco/garage/di/3/set", None),
        ("house/wisco/garage/do/3/mode/set", CommandTarget("garage", "3", Setting.MODE)),
        ("house/wisco/garage/do/3/hold/set", CommandTarget("garage", "3", Setting.HOLD)),
        ("house/wisco/garage/do/3/name/set", None),
        ("house/wisco/garage/do/3/mode/hold/set", None),
        ("house/wisco/garage/do/mode/set", CommandTarget("garage", "mode")),
        ("house/wisco/garage/di/3/mode/set", None),
        ("house/wisco/bridge/request/reload", RequestTarget("reload")),
        ("house/wisco/bridge/request", None),
        ("house/wisco/bridge/response/reload", None),
        ("house/wisco", None),
        ("house/wiscox/garage/set", None),
        ("house/wisco/garage/cover/gate/set", CoverTarget("garage", "gate")),
        ("house/wisco/garage/cover/gate/position/set", CoverTarget("garage", "gate", True)),
        ("house/wisco/garage/cover/gate/state/set", None),
        ("house/wisco/garage/cover/set", None),
        ("house/wisco/garage/cover/gate/position", None),
        ("other/garage/set", None),
        ("wisco/garage/set", None),
    ],
)
def test_parse(
    topic: str, expected: CommandTarget | CoverTarget | RequestTarget | OwnTopic | None
) -> None:
    """A topic means what docs/contract.md says, or nothing."""
    assert TOPICS.parse(topic) == expected


def test_target_names() -> None:
    """`do/3` for one output, `do` for several, `do/3/mode` for a setting."""
    assert CommandTarget("garage", "3").name == "do/3"
    assert CommandTarget("garage", "3", Setting.MODE).name == "do/3/mode"
    assert CommandTarget("garage", "3", Setting.HOLD).name == "do/3/hold"
    assert CommandTarget("garage", None).name == "do"
    assert CoverTarget("garage", "gate", position=True).name == "cover/gate"


def test_a_huge_channel_is_cut() -> None:
    """A channel of 60,000 digits does not make verdicts of 60,000 bytes."""
    target = TOPICS.parse(f"house/wisco/garage/do/{'1' * 60_000}/set")
    assert isinstance(target, CommandTarget)
    assert len(target.name) < 40
    cover = TOPICS.parse(f"house/wisco/garage/cover/{'x' * 60_000}/set")
    assert isinstance(cover, CoverTarget)
    assert len(cover.name) < 60


def test_the_name_of_a_cover_is_never_cut_to_that_of_another() -> None:
    """An id has at most 48 characters: what is longer names no cover, and moves none."""
    cover = TOPICS.parse(f"house/wisco/garage/cover/{'x' * 48}y/set")
    assert isinstance(cover, CoverTarget)
    assert cover.cover != "x" * 48


def test_subscriptions_are_live_only() -> None:
    """What the broker stored before is no command."""
    subscriptions = TOPICS.subscriptions("homeassistant/status")
    assert all(s.live_only and s.qos == 1 for s in subscriptions)


@pytest.mark.parametrize(
    ("topic", "own"),
    [
        ("house/wisco", True),
        ("house/wisco/garage/result", True),
        ("house/wisco2", False),
        ("house", False),
    ],
)
def test_is_own(topic: str, own: bool) -> None:
    """Only the base topic itself and what lies below it is the bridge's own."""
    assert TOPICS.is_own(topic) is own
