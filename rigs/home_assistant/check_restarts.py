"""Restarts of everything: all entities come back, once each, and no relay is switched."""

from collections.abc import Callable, Iterator

import pytest
from home_assistant.home import WAYS, Home, home, started_broker, timed
from home_assistant.houses import EVERYTHING

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
        for station, output in _ON:
            entity_id = f"switch.wisco_{station.replace('-', '_')}_do_{output}"
            shown.assistant.live.call("switch.turn_on", entity_id)
            shown.assistant.live.wait_state(entity_id, "on")
        yield shown


@pytest.mark.parametrize(
    "restart", [restart_home_assistant, restart_bridge, kill_bridge, restart_broker]
)
def test_everything_comes_back_and_nothing_is_switched(
    switched_on: Home, persistent: bool, restart: Callable[[Home], None]
) -> None:
    """The same entities under the same ids, all available, and every relay as it was."""
    before = switched_on.ids()
    outputs, ordered = switched_on.house.outputs, switched_on.house.ordered
    took_s = timed(lambda: restart(switched_on)) + switched_on.wait_until_complete()
    broker = "a persistent broker" if persistent else "a forgetful broker"
    name = restart.__name__.replace("_", " ")
    switched_on.note(f"{name}, {broker}: all available again {took_s:.1f} s after it was begun")
    assert switched_on.ids() == before
    for station, output in _ON:
        entity_id = f"switch.wisco_{station.replace('-', '_')}_do_{output}"
        switched_on.assistant.live.wait_state(entity_id, "on")
    assert switched_on.house.outputs == outputs
    assert switched_on.house.ordered == ordered
