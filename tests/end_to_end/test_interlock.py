"""Interlocked outputs through frames, a real mosquitto and the real daemon."""

import json
from pathlib import Path

from support.daemon import Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, broker, is_complete, panel, results, write_config

from bridge.model import LineProtocol


def _verdict(probe: MqttProbe, topic: str, wish: dict[str, object]) -> dict[str, object]:
    """Publishes a command; returns its verdict, which is the first that comes."""
    probe.clear()
    probe.publish(f"{BASE}/{topic}", json.dumps(wish))
    return results(probe.wait_for(lambda seen: bool(results(seen))))[0]


def test_two_directions_are_never_on_at_once(tmp_path: Path) -> None:
    """Refused while the other is ON, and in the dead time after; the relay never moved."""
    with panel(LineProtocol.WISCO) as line, broker(tmp_path) as mosquitto:
        config = write_config(tmp_path, line, mosquitto.port)
        station = "id: garage, interlock: [[1, 2]], interlock_dead_time: 1s}"
        config.write_text(config.read_text().replace("id: garage}", station))
        line.module(1).set_output(1, True)  # before anybody looks
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config):
            probe.wait_for(is_complete)
            found = [
                _verdict(probe, "garage/do/2/set", {"state": "ON"}),
                _verdict(probe, "garage/set", {"do": {"1": "OFF", "2": "ON"}}),
                _verdict(probe, "garage/do/1/set", {"state": "OFF"}),
                _verdict(probe, "garage/do/2/set", {"state": "ON"}),
            ]
            while (last := _verdict(probe, "garage/do/2/set", {"state": "ON"}))["status"] != "done":
                assert last["reason"] == "interlock"
    assert [verdict.get("reason") for verdict in found] == [
        "interlock", "interlock", None, "interlock",
    ]  # fmt: skip
    assert all("output 1" in str(found[n]["detail"]) for n in (0, 1, 3))
    switched = {(s.output, s.value): s.at for s in line.module(1).switchings if s.frame}
    assert set(switched) == {(1, False), (2, True)}
    assert switched[2, True] - switched[1, False] >= 1.0
