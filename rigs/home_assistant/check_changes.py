"""Changes of the configuration: no ghost, nothing left over, and what stays keeps its ids."""

from collections.abc import Iterator

import pytest
from home_assistant.home import WAYS, Home, home, started_broker
from home_assistant.house import retained, wait_until
from home_assistant.houses import EVERYTHING
from home_assistant.live import Change
from home_assistant.releases import NEW

from bridge.model import DO100
from bridge.simulator.module import SimulatedModule

_CELLAR = "    - {address: 2, model: DO100, id: cellar, name: Cellar}\n"
_NORTH = "      model: DIO100\n      id: north-wing_2\n"


@pytest.fixture(params=WAYS)
def shown(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Home]:
    """Return the entities of one of each kind."""
    release, discovery = request.param
    directory = tmp_path_factory.mktemp("changes")
    with (
        started_broker(directory / "broker") as broker,
        home(directory / "house", broker, release, EVERYTHING, discovery) as built,
    ):
        yield built


def states_of(shown: Home, station_id: str) -> list[str]:
    """The states of a station that the broker retains."""
    return list(retained(shown.house.broker.port, f"wisco/{station_id}/#"))


def test_a_station_that_is_removed_renamed_or_another_model(shown: Home) -> None:
    """One change after the other, each without a restart of anything."""
    before = shown.ids()

    shown.house.reconfigure(EVERYTHING.replace(_CELLAR, ""), shown.discovery)
    shown.wait_until_complete()
    assert shown.ids() == {k: v for k, v in before.items() if "__cellar__" not in k}
    assert "wisco__cellar" not in shown.assistant.live.devices()
    wait_until(lambda: not states_of(shown, "cellar"), "the states of the cellar are cleared")

    renamed = EVERYTHING.replace(_CELLAR, "").replace("name: Garage ä", "name: Carport")
    renamed = renamed.replace("name: Lamp,", "name: Lantern,")
    shown.house.reconfigure(renamed, shown.discovery)
    shown.wait_until_complete()
    assert shown.ids() == {k: v for k, v in before.items() if "__cellar__" not in k}
    assert shown.assistant.live.devices()["wisco__garage"]["name"] == "Carport"
    shown.assistant.live.wait_for(
        lambda states: "Carport Lantern" in _friendly_names(states),
        otherwise=lambda: str(sorted(_friendly_names(shown.assistant.live.states))),
    )

    without_rule = renamed.partition("rules:")[0]  # it names an input that a DO100 has not
    other = without_rule.replace(_NORTH, _NORTH.replace("DIO100", "DO100"))
    shown.house.lines["annex"].modules[1] = SimulatedModule(DO100, 1)
    shown.house.reconfigure(other, shown.discovery)
    shown.wait_until_complete()
    kept = {k: v for k, v in shown.ids().items() if k in before}
    assert kept == {k: v for k, v in before.items() if _is_kept(k)}
    assert shown.assistant.live.devices()["wisco__north-wing_2"]["model"] == "DO100"
    wait_until(lambda: not states_of(shown, "north-wing_2/di"), "those of the inputs, too")
    shown.note("station removed, renamed, another model: 0 ghosts, 0 left over, ids kept")

    shown.house.reconfigure(EVERYTHING, "off")
    shown.wait_until_complete()
    assert shown.ids() == {}
    assert shown.house.announcements() == {}
    shown.note("discovery off: 0 entities, 0 announcements retained")
    assert shown.assistant.complaints() == []


def _friendly_names(states: dict[str, Change]) -> set[str]:
    return {change.attributes.get("friendly_name", "") for change in states.values()}


def _is_kept(unique_id: str) -> bool:
    gone = ("__cellar__", "__north-wing_2__di_", "__rule_")
    return not any(part in unique_id for part in gone)


@pytest.mark.parametrize("shown", [(NEW, "device"), (NEW, "single")], indirect=True)
def test_another_form_of_discovery_keeps_every_entity(shown: Home) -> None:
    """A change of `discovery`, there and back, keeps ids, user names and areas of all entities."""
    before = shown.ids()
    renamed = "switch.my_pump"
    pump = before["wisco__garage__do_4_switch"]
    shown.assistant.live.ask(
        "config/entity_registry/update", entity_id=pump, new_entity_id=renamed, name="My pump"
    )
    wanted = {**before, "wisco__garage__do_4_switch": renamed}
    forms = {"device": "single", "single": "device"}
    for form in (forms[shown.discovery], shown.discovery):
        shown.house.reconfigure(EVERYTHING, form)
        shown.wait_until_complete()
        assert shown.ids() == wanted
        entry = shown.assistant.live.entities()["wisco__garage__do_4_switch"]
        assert entry["name"] == "My pump"
        shown.assistant.live.call("switch.toggle", renamed)
        shown.assistant.live.wait_state(renamed, "on" if form != shown.discovery else "off")
    shown.note("to the other form of discovery and back: every id and name kept, 0 left over")
