"""An update of the bridge: what people have in Home Assistant stays theirs."""

import pytest
from home_assistant.former import FORMER
from home_assistant.home import WAYS, home, started_broker
from home_assistant.house import wait_until
from home_assistant.houses import EVERYTHING
from home_assistant.releases import Release

_KNOWN = EVERYTHING.partition("rules:")[0]  # the former release has no rules
# What this release has no more: a declared latch has no hold time.
_GONE = {"wisco__garage__do_8_hold_number"}
_PUMP, _RENAMED = "switch.wisco_garage_do_4", "switch.my_pump"
_KEPT = ("entity_id", "name", "icon", "area_id", "disabled_by", "id")


@pytest.mark.parametrize("way", WAYS)
def test_ids_names_and_history_stay(
    way: tuple[Release, str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The release of today is set up and used, then this one runs in its place.

    History belongs to the entity id, and begins anew for an entity that was away.
    """
    release, discovery = way
    directory = tmp_path_factory.mktemp("update")
    with (
        started_broker(directory / "broker") as broker,
        home(directory / "house", broker, release, _KNOWN, discovery, former=True) as shown,
    ):
        live = shown.assistant.live
        live.ask(
            "config/entity_registry/update",
            entity_id=_PUMP,
            new_entity_id=_RENAMED,
            name="My pump",
            icon="mdi:pump",
        )
        live.wait_for(lambda states: _RENAMED in states)
        live.call("switch.turn_on", _RENAMED)
        live.wait_state(_RENAMED, "on")
        before, devices = live.entities(), live.devices()
        live.forget()
        shown.house.update_bridge()
        wait_until(lambda: not _GONE & shown.announced.keys(), "the announcements of this release")
        shown.wait_until_complete()
        after = live.entities()
        assert before.keys() - after.keys() == _GONE
        for name in before.keys() - _GONE:
            assert _kept(after[name]) == _kept(before[name])
        assert {name: one["id"] for name, one in live.devices().items()} == {
            name: one["id"] for name, one in devices.items()
        }
        stayed = {before[name]["entity_id"] for name in before.keys() - _GONE}
        removed = [one for one in stayed if any(c.state is None for c in live.history(one))]
        assert removed == []
        assert live.state(_RENAMED) == "on"
        new = sorted(name.removeprefix("wisco__") for name in after.keys() - before.keys())
        shown.note(
            f"from {FORMER.commit} to this release: {len(stayed)} entities kept, {len(_GONE)} gone "
            f"by intent, {len(new)} new ({', '.join(new)})"
        )
        # States come before announcements: an old release hears of an unknown cover in words that
        # its old announcement does not explain, and passes over them.
        known = "components.mqtt.cover] Payload is not supported"
        assert [one for one in shown.assistant.complaints() if known not in one] == []


def _kept(entry: dict[str, object]) -> dict[str, object]:
    return {key: entry[key] for key in _KEPT}
