import json
from typing import Any

import pytest
from support.house import CELLAR, GARAGE, make_config

from bridge.config.schema import OutputConfig, StationConfig
from bridge.mqtt.announce.discovery import discovery_messages
from bridge.mqtt.announce.migration import MIGRATE, Announcement, DiscoveryTopics, announce
from bridge.mqtt.events import OutMessage

DEVICE = "homeassistant/device/wisco__garage/config"
LAMP = "homeassistant/light/wisco__garage/do_1_light/config"
BRIDGE_SINGLE = "homeassistant/binary_sensor/wisco__bridge/connectivity_binary_sensor/config"


def garage_with(*outputs: OutputConfig) -> StationConfig:
    """The garage with these outputs alone."""
    return StationConfig(1, GARAGE.model, "garage", "Garage", inputs=(), outputs=outputs)


TWO = garage_with(OutputConfig(1, kind="light"), OutputConfig(2, mode="pulse", hold_s=0.5))
ONE = garage_with(OutputConfig(1, kind="light"))


def messages(form: str, *stations: StationConfig) -> list[OutMessage]:
    """Return the announcements of these stations."""
    return discovery_messages(make_config(form, stations=stations))


def retained(form: str, *stations: StationConfig) -> dict[str, bytes]:
    """Return the retained messages after their announcement."""
    return {message.topic: message.payload for message in messages(form, *stations)}


def plan(form: str, *stations: StationConfig, given: dict[str, bytes]) -> Announcement:
    """Return the plan from the retained messages to these stations."""
    topics = DiscoveryTopics(make_config(form, stations=stations))
    return announce(messages(form, *stations), given, topics)


def after(given: dict[str, bytes], *batches: tuple[OutMessage, ...]) -> dict[str, bytes]:
    """Return the retained messages after these batches."""
    held = dict(given)
    for message in (message for batch in batches for message in batch):
        assert (message.qos, message.retain) == (1, True)
        held[message.topic] = message.payload
    return {topic: payload for topic, payload in held.items() if payload}


def document(batch: tuple[OutMessage, ...], topic: str) -> Any:
    """The one message to a topic, decoded."""
    [payload] = [message.payload for message in batch if message.topic == topic]
    return json.loads(payload)


@pytest.mark.parametrize("form", ["device", "single", "off"])
@pytest.mark.parametrize("before", ["nothing", "the same"])
def test_where_nothing_changes_there_is_one_step(form: str, before: str) -> None:
    """A first announcement, and one that is there already: the configurations, in order."""
    given = retained(form, GARAGE, CELLAR) if before == "the same" else {}
    steps = plan(form, GARAGE, CELLAR, given=given)
    assert steps == Announcement((), tuple(messages(form, GARAGE, CELLAR)), ())
    assert steps.cleared == []


@pytest.mark.parametrize("old", ["device", "single", "off"])
@pytest.mark.parametrize("new", ["device", "single", "off"])
def test_every_way_ends_with_what_is_configured(old: str, new: str) -> None:
    """From any earlier announcement the result is that of a first announcement."""
    given = retained(old, TWO, CELLAR)
    steps = plan(new, ONE, given=given)
    held = after(given, *steps.before, steps.configs, steps.after)
    assert held == retained(new, ONE)


@pytest.mark.parametrize("form", ["device", "single"])
def test_a_station_that_is_gone_is_cleared(form: str) -> None:
    """The topics of a removed station are cleared after the announcement of the others."""
    steps = plan(form, GARAGE, given=retained(form, GARAGE, CELLAR))
    assert steps.before == ()
    assert steps.configs == tuple(messages(form, GARAGE))
    assert sorted(steps.cleared) == sorted(
        set(retained(form, GARAGE, CELLAR)) - set(retained(form, GARAGE))
    )


def test_a_component_of_a_device_is_named_before_it_is_left_out() -> None:
    """A removed component is first sent with only its platform, then left out."""
    steps = plan("device", ONE, given=retained("device", TWO))
    named = document(steps.configs, DEVICE)["components"]
    assert named.pop("do_2_button") == {"platform": "button"}
    assert named.pop("do_2_binary_sensor") == {"platform": "binary_sensor"}
    assert named == json.loads(retained("device", ONE)[DEVICE])["components"]
    assert after({}, steps.after) == {DEVICE: retained("device", ONE)[DEVICE]}
    assert steps.cleared == []


def test_a_removal_that_was_cut_short_is_repeated() -> None:
    """A component that is still named from the last time is named once more."""
    halfway = plan("device", ONE, given=retained("device", TWO)).configs
    steps = plan("device", ONE, given=after({}, halfway))
    assert document(steps.configs, DEVICE)["components"]["do_2_button"] == {"platform": "button"}


@pytest.mark.parametrize(("old", "new"), [("single", "device"), ("device", "single")])
def test_from_one_form_to_the_other(old: str, new: str) -> None:
    """The old topics ask for the migration, then comes the new form, then they are emptied."""
    given = retained(old, GARAGE)
    steps = plan(new, GARAGE, given=given)
    [asked] = steps.before
    assert {message.topic: message.payload for message in asked} == dict.fromkeys(given, MIGRATE)
    assert steps.configs == tuple(messages(new, GARAGE))
    assert sorted(steps.cleared) == sorted(given)


def test_a_component_that_is_gone_does_not_migrate() -> None:
    """A removed component is deleted, not unloaded, as it would remain as a ghost."""
    to_device = plan("device", ONE, given=retained("single", TWO))
    [asked] = to_device.before
    assert not [message.topic for message in asked if "do_2" in message.topic]
    assert len([topic for topic in to_device.cleared if "do_2" in topic]) == 2
    trimmed, asked = plan("single", ONE, given=retained("device", TWO)).before
    components = document(trimmed, DEVICE)["components"]
    assert components["do_2_button"] == {"platform": "button"}
    assert "unique_id" in components["do_1_light"]
    assert DEVICE in {message.topic for message in asked}


@pytest.mark.parametrize(("old", "new"), [("single", "device"), ("device", "single")])
@pytest.mark.parametrize("done", [0, 1, 2])
def test_a_migration_that_was_cut_short_is_repeated(old: str, new: str, done: int) -> None:
    """Wherever it stopped, the next attempt asks again and ends as it should."""
    given = retained(old, TWO)
    steps = plan(new, TWO, given=given)
    halfway = after(given, *(*steps.before, steps.configs)[:done])
    again = plan(new, TWO, given=halfway)
    assert [message.payload for message in again.before[-1]] == [MIGRATE] * len(given)
    assert after(halfway, *again.before, again.configs, again.after) == retained(new, TWO)


@pytest.mark.parametrize("payload", [b"", b"\xff", b"[]", b'{"components": 1}', b"{" * 5000])
def test_what_cannot_be_read_is_overwritten_or_cleared(payload: bytes) -> None:
    """A broken announcement on a topic of ours is no reason to stop."""
    given = {DEVICE: payload, LAMP: payload}
    assert plan("device", ONE, given=given).cleared == [LAMP]
    assert plan("single", ONE, given=given).cleared == [DEVICE]


@pytest.mark.parametrize(
    "topic",
    [
        "homeassistant/device/zigbee/config",
        "homeassistant/device/wisco2__old/config",
        "homeassistant/device/wisco/config",
        "homeassistant/device/wisco__/config",
        "homeassistant/device/wisco__b__old/config",  # of a bridge at wisco/b
        "homeassistant/device/wisco__x/y/config",
        "homeassistant/switch/wisco__b__old/do_1_switch/config",
        "homeassistant/switch/wisco__old/config",
        "homeassistant/switch/wisco__old/do_1_switch/state",
        "elsewhere/device/wisco__old/config",
    ],
)
def test_other_announcements_are_left_alone(topic: str) -> None:
    """Only what has our node ids in our forms is ours."""
    assert plan("device", ONE, given={topic: b"{}"}).cleared == []
    assert plan("off", ONE, given={topic: b"{}"}).cleared == []


def test_turning_discovery_off_clears_everything() -> None:
    """The bridge's own device included, in whichever form."""
    for form in ("device", "single"):
        steps = plan("off", given=retained(form, GARAGE))
        assert (steps.before, steps.configs) == ((), ())
        assert sorted(steps.cleared) == sorted(retained(form, GARAGE))
    assert BRIDGE_SINGLE in retained("single", GARAGE)
