"""Scenes: all relays of a slow line, by one service of Home Assistant."""

import json
import time
from collections import Counter

import pytest
from home_assistant.home import WAYS, Home, home, started_broker
from home_assistant.house import wait_until
from home_assistant.houses import RELAYS
from home_assistant.releases import Release
from support.mqtt_probe import MqttProbe

_ALL = 0xFFFF
_STATIONS = 4
_SCENES = 5


@pytest.mark.parametrize("way", WAYS)
def test_a_scene_of_64_outputs(
    way: tuple[Release, str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Each switch gets its verdict `done`, and ON with OFF soon behind it leaves nothing ON."""
    release, discovery = way
    directory = tmp_path_factory.mktemp("scenes")
    with (
        started_broker(directory / "broker") as broker,
        home(directory / "house", broker, release, RELAYS, discovery) as shown,
        MqttProbe(broker.port, "wisco/+/result") as results,
    ):
        switches = [e for k, e in shown.ids().items() if "__do_" in k and k.endswith("_switch")]
        assert len(switches) == 16 * _STATIONS
        for number in range(2 * _SCENES):
            word, wanted = ("off", 0) if number % 2 else ("on", _ALL)
            took_s = _scene(shown, results, switches, word, wanted)
            shown.note_slowest(f"64 switches {word}: all verdicts done after", took_s)
        for tenths in range(0, 11, 2):
            results.clear()
            _call(shown, switches, "on")
            time.sleep(tenths / 10)
            _call(shown, switches, "off")
            wait_until(lambda: len(results.seen) == 2 * len(switches), "a verdict for each")
            assert set(shown.house.outputs.values()) == {0}
        shown.note("64 switches on, and off 0-1 s later: 0 relays left ON, one verdict for each")


def _scene(shown: Home, results: MqttProbe, switches: list[str], word: str, wanted: int) -> float:
    """Switches all; returns the seconds from the call to the last verdict."""
    results.clear()
    began = time.monotonic()
    _call(shown, switches, word)
    wait_until(lambda: len(results.seen) >= len(switches), "a verdict for each")
    took_s = time.monotonic() - began
    statuses = Counter(json.loads(one.payload)["status"] for one in results.seen)
    assert statuses == {"done": len(switches)}
    assert set(shown.house.outputs.values()) == {wanted}
    shown.assistant.live.wait_for(
        lambda states: all(states[entity].state == word for entity in switches)
    )
    return took_s


def _call(shown: Home, switches: list[str], word: str) -> None:
    shown.assistant.live.ask(
        "call_service",
        domain="switch",
        service=f"turn_{word}",
        target={"entity_id": switches},
    )
