"""Brokers and ports that come and go: everything is complete again, and no relay switched."""

import time
from pathlib import Path

from support.brokers import new_broker
from support.daemon import Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, STATIONS, is_complete, panel, panel_filters, write_config

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine

BROKER_AWAY_S = 20.0  # long enough for the pauses between attempts to have grown to their longest
CONNECTED_WITHIN_S = 12.0
COMPLETE_WITHIN_S = 10.0
PORT_AWAY_S = 5.0


def _orders(line: SimulatedLine) -> int:
    """Return the number of orders to any output of any module."""
    return sum(len(line.module(address).switchings) for address, _ in STATIONS.values())


def test_a_broker_that_comes_20_s_late_gets_everything(tmp_path: Path) -> None:
    """Absent at start is no error: 12 s after the broker's start all is there, retained."""
    mosquitto = new_broker(tmp_path / "broker")
    with panel(LineProtocol.WISCO) as line:
        config = write_config(tmp_path, line, mosquitto.port)
        with Daemon(config) as daemon:
            daemon.wait_for_log("online: DO100")
            time.sleep(BROKER_AWAY_S)  # the outage itself, not a wait for anything
            assert daemon.process.poll() is None
            mosquitto.start()
            try:
                daemon.wait_for_log("connected to the broker")
                began = time.monotonic()
                with MqttProbe(mosquitto.port, *panel_filters()) as probe:
                    probe.wait_for(is_complete, CONNECTED_WITHIN_S)
                    assert time.monotonic() - began < CONNECTED_WITHIN_S
            finally:
                mosquitto.stop()
        assert _orders(line) == 0


def test_a_broker_restarted_without_persistence_is_complete_again(tmp_path: Path) -> None:
    """Within 10 s of its return it holds everything that it held before."""
    mosquitto = new_broker(tmp_path / "broker")
    mosquitto.start()
    try:
        with panel(LineProtocol.MODBUS_RTU) as line:
            with Daemon(write_config(tmp_path, line, mosquitto.port)):
                with MqttProbe(mosquitto.port, f"{BASE}/#", "homeassistant/#") as probe:
                    probe.wait_for(is_complete)
                    announced = {m.topic for m in probe.seen if m.topic.endswith("/config")}
                mosquitto.restart()
                with MqttProbe(mosquitto.port, f"{BASE}/#", "homeassistant/#") as probe:
                    probe.wait_for(
                        lambda seen: is_complete(seen) and announced <= {m.topic for m in seen},
                        COMPLETE_WITHIN_S,
                    )
            assert announced
            assert _orders(line) == 0
    finally:
        mosquitto.stop()


def test_a_port_that_hangs_up_for_5_s_comes_back_by_itself(tmp_path: Path) -> None:
    """Line and stations go offline, then states return; no relay is touched."""
    mosquitto = new_broker(tmp_path / "broker")
    mosquitto.start()
    line_topic = f"{BASE}/bridge/line/main/availability"
    try:
        with panel(LineProtocol.MODBUS_ASCII) as line:
            config = write_config(tmp_path, line, mosquitto.port)
            with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config):
                probe.wait_for(is_complete)
                line.module(1).set_output(3, True)  # by hand, not by the bridge
                probe.wait_message(f"{BASE}/garage/do/3", "ON")
                switched_by_hand = _orders(line)
                probe.clear()
                line.hang_up()
                probe.wait_message(line_topic, "offline")
                for name in STATIONS:
                    probe.wait_message(f"{BASE}/{name}/availability", "offline")
                time.sleep(PORT_AWAY_S)  # the outage itself
                line.module(1).set_input(7, True)  # while nobody looks
                probe.clear()
                line.restore()
                probe.wait_message(line_topic, "online")
                for name in STATIONS:
                    probe.wait_message(f"{BASE}/{name}/availability", "online")
                topics = [message.topic for message in probe.seen]
                states = topics.index(f"{BASE}/garage/di/7")
                assert states < topics.index(f"{BASE}/garage/availability")
            assert _orders(line) == switched_by_hand
            assert line.module(1).outputs == 0b100
    finally:
        mosquitto.stop()
