"""Restarts of everything: all entities come back, once each, and nothing happens again.

No relay is switched, and no old press and no old verdict starts an automation of the guide.
"""

import time
from collections.abc import Callable, Iterator

import pytest
from home_assistant.home import WAYS, Home, home, started_broker, timed
from home_assistant.house import wait_until
from home_assistant.houses import EVERYTHING

_STALE_S = 1.0  # the bridge refuses what comes just after it has proven its link
_BUTTON = "binary_sensor.wisco_garage_di_3"
_BRIDGE = "binary_sensor.wisco_bridge_connectivity"
# Outputs that are ON meanwhile: a relay that is switched shows.
_ON = (("garage", 4), ("cellar", 16), ("north-wing_2", 8), ("annex_02", 16))


def restart_home_assistant(shown: Home) -> None:
    """Restart Home Assistant, which reads the retained announcements again."""
    shown.assistant.restart()


def restart_bridge(shown: Home) -> None:
    """A clean stop takes everything offline first."""
    shown.house.daemon.stop()
    shown.assistant.live.wait_state(_BRIDGE, "off")
    shown.house.daemon.__enter__()


def kill_bridge(shown: Home) -> None:
    """Kill the bridge; the last will takes everything offline."""
    shown.house.daemon.process.kill()
    shown.house.daemon.process.wait()
    shown.assistant.live.wait_state(_BRIDGE, "off")
    shown.house.daemon.__enter__()


def restart_broker(shown: Home) -> None:
    """Both lose their connection, and come back when they like."""
    shown.house.broker.stop()
    shown.assistant.live.wait_state(_BRIDGE, "unavailable")
    shown.house.broker.start()


def lose_module(shown: Home) -> None:
    """The module with the button and the gate does not answer for a while."""
    connection = "binary_sensor.wisco_garage_connectivity"
    shown.house.module("garage").away = True
    shown.assistant.live.wait_state(connection, "off")
    shown.house.module("garage").away = False
    shown.assistant.live.wait_state(connection, "on")


def lose_line(shown: Home) -> None:
    """The adapter of its line is pulled, and plugged in again."""
    connection = "binary_sensor.wisco_bridge_line_main_connectivity"
    shown.house.lines["main"].hang_up()
    shown.assistant.live.wait_state(connection, "off")
    shown.house.lines["main"].restore()
    shown.assistant.live.wait_state(connection, "on")


def reload_configuration(shown: Home) -> None:
    """Its line has another configuration, and then the one before."""
    for text in (EVERYTHING.replace("name: Cellar", "name: Vault"), EVERYTHING):
        shown.house.reconfigure(text, shown.discovery)


@pytest.fixture(scope="module", params=[True, False], ids=["persistent", "forgetful"])
def persistent(request: pytest.FixtureRequest) -> bool:
    """Return whether the broker keeps retained messages over a restart."""
    return bool(request.param)


@pytest.fixture(scope="module", params=WAYS)
def switched_on(
    request: pytest.FixtureRequest, persistent: bool, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Home]:
    """Every kind of entity, with some outputs ON; tests share it."""
    release, discovery = request.param
    directory = tmp_path_factory.mktemp("restarts")
    with (
        started_broker(directory / "broker", persistence=persistent) as broker,
        home(directory / "house", broker, release, EVERYTHING, discovery) as shown,
    ):
        for station_id, output in _ON:
            entity_id = f"switch.wisco_{station_id.replace('-', '_')}_do_{output}"
            shown.assistant.live.call("switch.turn_on", entity_id)
            shown.assistant.live.wait_state(entity_id, "on")
        press(shown)
        refuse(shown)
        yield shown


def press(shown: Home) -> None:
    """Press the button of the gate: each of its automations runs once."""
    time.sleep(_STALE_S)
    module, before = shown.house.module("garage"), shown.assistant.live.automated
    ordered = module.ordered[2, True]
    for level in (True, False):
        module.set_input(3, level)
        shown.assistant.live.wait_state(_BUTTON, "on" if level else "off")
    automations = 2 if shown.assistant.release.receives_events else 1
    wait_until(lambda: module.ordered[2, True] >= ordered + automations, "the gate moves")
    wait_until(lambda: not module.outputs & 0b10, "the pulse ends")
    assert _ran(shown, before, "Open") == automations
    assert module.ordered[2, True] == ordered + automations


def refuse(shown: Home) -> None:
    """The boiler is read-only: the automation that tells of it runs once."""
    before = shown.assistant.live.automated
    shown.house.probe.publish("wisco/garage/do/3/set", "ON")
    wait_until(lambda: _ran(shown, before, "Say") >= 1, "the verdict")
    assert _ran(shown, before, "Say") == 1


def _ran(shown: Home, before: list[str], name: str) -> int:
    """How often automations with such a name ran since then."""
    return sum(one.startswith(name) for one in shown.assistant.live.automated[len(before) :])


def _last_runs(shown: Home) -> dict[str, str]:
    """When each automation last ran; Home Assistant remembers it over a restart."""
    found = {
        name: change.attributes["last_triggered"]
        for name, change in shown.assistant.live.states.items()
        if name.startswith("automation.")
    }
    assert all(found.values()), found
    return found


@pytest.mark.parametrize(
    "restart",
    [
        restart_home_assistant,
        restart_bridge,
        kill_bridge,
        restart_broker,
        lose_module,
        lose_line,
        reload_configuration,
    ],
)
def test_everything_comes_back_and_nothing_happens_again(
    switched_on: Home, persistent: bool, restart: Callable[[Home], None]
) -> None:
    """The same entities, all available, every relay as it was, no automation run again."""
    before, last_runs = switched_on.ids(), _last_runs(switched_on)
    outputs, ordered = switched_on.house.outputs, switched_on.house.ordered
    took_s = timed(lambda: restart(switched_on)) + switched_on.wait_until_complete()
    broker = "a persistent broker" if persistent else "a forgetful broker"
    name = restart.__name__.replace("_", " ")
    switched_on.note(f"{name}, {broker}: all available again {took_s:.1f} s after it was begun")
    assert switched_on.ids() == before
    for station_id, output in _ON:
        entity_id = f"switch.wisco_{station_id.replace('-', '_')}_do_{output}"
        switched_on.assistant.live.wait_state(entity_id, "on")
    assert switched_on.house.outputs == outputs
    assert switched_on.house.ordered == ordered
    again = [one for one, at in _last_runs(switched_on).items() if at != last_runs[one]]
    switched_on.note(f"{name}, {broker}: {len(again)} presses and verdicts fired again")
    assert again == []
    press(switched_on)
    refuse(switched_on)


@pytest.mark.parametrize("persistent", [True], ids=["persistent"], indirect=True)
def test_what_the_bridge_did_meanwhile_is_told(switched_on: Home) -> None:
    """The time of an output ends while Home Assistant is away; it says so when it is back."""
    module = switched_on.house.module("north-wing_2")
    switched_on.assistant.live.call("switch.turn_on", "switch.wisco_north_wing_2_do_3")
    wait_until(lambda: bool(module.outputs & 0b100), "the output goes ON")
    switched_on.assistant.stop()
    wait_until(lambda: not module.outputs & 0b100, "its time ends")
    switched_on.assistant.start()
    action = switched_on.assistant.live.wait_state(
        "sensor.wisco_north_wing_2_own_action", "do/3 OFF by max_on"
    )
    assert action.attributes["actions"][0]["detail"] == "it was ON for 3 s"
    switched_on.wait_until_complete()
