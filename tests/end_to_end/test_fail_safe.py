"""`max_on` and `on_loss` through frames, a real mosquitto and the real daemon."""

import json
import time
from pathlib import Path

from support.daemon import WAIT_S, Daemon
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, broker, is_complete, panel, panel_filters, results, write_config

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Switching


def _configure(config: Path, outputs: str) -> None:
    text = config.read_text()
    config.write_text(text.replace("id: garage}", f"id: garage, outputs: {{{outputs}}}}}"))


def _orders(line: SimulatedLine) -> list[Switching]:
    """Return the orders of frames to station 1, without manual switchings."""
    return [switching for switching in line.module(1).switchings if switching.frame]


def _wait_for_orders(line: SimulatedLine, count: int) -> list[Switching]:
    deadline = time.monotonic() + WAIT_S
    while len(_orders(line)) < count:
        assert time.monotonic() < deadline, f"only {_orders(line)}"
        time.sleep(0.01)  # a relay tells nobody that it moved: it is looked at again
    return _orders(line)


def _is_off_by_max_on(seen: list[Seen]) -> bool:
    return any(verdict.get("by") == "max_on" for verdict in results(seen))


def test_an_output_is_on_for_as_long_as_max_on_allows(tmp_path: Path) -> None:
    """Switched ON by a hand: one OFF on the wire, its state, and a line on the result topic."""
    with panel(LineProtocol.WISCO) as line, broker(tmp_path) as mosquitto:
        config = write_config(tmp_path, line, mosquitto.port)
        _configure(config, "3: {max_on: 2s}")
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config) as daemon:
            probe.wait_for(is_complete)
            began = time.monotonic()
            line.module(1).set_output(3, True)
            probe.wait_message(f"{BASE}/garage/do/3", "ON")
            seen = probe.wait_for(_is_off_by_max_on)
            probe.publish(f"{BASE}/garage/do/4/set", json.dumps({"state": "ON", "id": "next"}))
            probe.wait_for(lambda seen: any(v.get("id") == "next" for v in results(seen)))
            assert "do/3 OFF by max_on (it was ON for 2 s): done" in daemon.log
    topics = [message.topic for message in seen]
    assert topics.index(f"{BASE}/garage/result") > topics.index(f"{BASE}/garage/do/3")
    first, second = _orders(line)
    assert (first.output, first.value) == (3, False)
    assert 2.0 <= first.at - began <= 2.0 + 2.0 + 1.0  # and what a sweep of the outputs takes
    assert (second.output, second.value) == (4, True)


def test_outputs_take_their_states_when_the_broker_goes_away(tmp_path: Path) -> None:
    """`on_loss` switches once in a loss; a broker that returns in time switches nothing."""
    with panel(LineProtocol.MODBUS_RTU) as line, broker(tmp_path) as mosquitto:
        config = write_config(tmp_path, line, mosquitto.port)
        on_loss = "on_loss: {after: 3s, state: "
        _configure(config, f'1: {{{on_loss}"OFF"}}}}, 2: {{{on_loss}"ON"}}}}')
        line.module(1).set_output(1, True)
        line.module(1).set_output(3, True)
        with Daemon(config):
            with MqttProbe(mosquitto.port, *panel_filters()) as probe:
                probe.wait_for(is_complete)
            mosquitto.restart()
            with MqttProbe(mosquitto.port, *panel_filters()) as probe:
                probe.wait_for(is_complete)
                probe.wait_message(f"{BASE}/bridge/ping")  # live: it is connected again
            assert _orders(line) == []
            lost_at = time.monotonic()
            mosquitto.stop()
            orders = _wait_for_orders(line, 2)
            mosquitto.start()
            with MqttProbe(mosquitto.port, *panel_filters()) as probe:
                seen = probe.wait_for(lambda seen: is_complete(seen) and len(results(seen)) == 2)
    assert {(order.output, order.value) for order in orders} == {(1, False), (2, True)}
    assert all(3.0 <= order.at - lost_at <= 5.0 for order in orders)
    assert len(_orders(line)) == 2
    assert {str(verdict["by"]) for verdict in results(seen)} == {"on_loss"}
    assert line.module(1).outputs == 0b110
