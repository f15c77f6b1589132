"""A broker that comes late and is restarted: all is complete again, and no relay switched."""

import time
from pathlib import Path

from support.brokers import new_broker
from support.daemon import Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, STATIONS, is_complete, panel, panel_filters, write_config

from bridge.model import LineProtocol

CONNECTED_WITHIN_S = 12.0
COMPLETE_WITHIN_S = 10.0


def test_a_broker_that_comes_late_and_forgets_gets_everything(tmp_path: Path) -> None:
    """12 s after it accepts clients, and 10 s after a restart, all is retained that has to be."""
    mosquitto = new_broker(tmp_path / "broker")
    with panel(LineProtocol.MODBUS_RTU) as line:
        with Daemon(write_config(tmp_path, line, mosquitto.port)) as daemon:
            daemon.wait_for_log("online: DO100")
            mosquitto.start()  # rabbitmq-server takes some 12 s until it accepts clients
            began = time.monotonic()
            try:
                daemon.wait_for_log("connected to the broker")
                with MqttProbe(mosquitto.port, *panel_filters(), "homeassistant/#") as probe:
                    probe.wait_for(is_complete, CONNECTED_WITHIN_S)
                    assert time.monotonic() - began < CONNECTED_WITHIN_S
                    announced = {m.topic for m in probe.seen if m.topic.endswith("/config")}
                mosquitto.restart()
                with MqttProbe(mosquitto.port, f"{BASE}/#", "homeassistant/#") as probe:
                    probe.wait_for(
                        lambda seen: is_complete(seen) and announced <= {m.topic for m in seen},
                        COMPLETE_WITHIN_S,
                    )
                assert announced
            finally:
                mosquitto.stop()
        assert not any(line.module(address).switchings for address, _ in STATIONS.values())
