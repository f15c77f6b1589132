"""Four stations of which the configuration names nothing: how much they are to Home Assistant."""

import pytest
from home_assistant.home import WAYS, Home, home, started_broker
from home_assistant.houses import DEFAULTS
from home_assistant.releases import Release

# All, and those that are enabled.
ENTITIES = {"DIO100": (48, 28), "DO100": (56, 20)}


@pytest.mark.parametrize("way", WAYS)
def test_a_default_station_has_few_entities_and_a_restart_changes_each_twice(
    way: tuple[Release, str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Each enabled entity becomes unavailable and comes back; nothing else changes."""
    release, discovery = way
    directory = tmp_path_factory.mktemp("defaults")
    with (
        started_broker(directory / "broker") as broker,
        home(directory / "house", broker, release, DEFAULTS, discovery) as shown,
    ):
        stations = [one for line in shown.house.config.lines for one in line.stations]
        for config in stations:
            found = _entities(shown, f"wisco__{config.id}")
            assert found == ENTITIES[config.model.name]
            shown.note(f"a {config.model.name}: {found[0]} entities, {found[1]} enabled")
        enabled = sum(e["disabled_by"] is None for e in shown.assistant.live.entities().values())
        before = shown.assistant.live.changes
        shown.house.restart_bridge()
        shown.wait_until_complete()
        changes = shown.assistant.live.changes - before
        shown.note(f"restart of the bridge: {changes} state changes of {enabled} enabled entities")
        # The connection of a station is seen off besides, between the bridge's return and its own.
        assert changes <= 2 * enabled + len(stations)


def _entities(shown: Home, device: str) -> tuple[int, int]:
    """All entities of a device, and those that are enabled."""
    known = shown.assistant.live.devices()[device]["id"]
    found = [e for e in shown.assistant.live.entities().values() if e["device_id"] == known]
    return len(found), sum(entry["disabled_by"] is None for entry in found)
