"""A second bridge on one machine ends at once, and the first notices nothing."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.daemon import WAIT_S, Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, broker, is_complete, panel, write_config

from bridge.errors import PortBusyError
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from bridge.simulator.tcp import TcpEndpoint
from bridge.transport.opener import open_port


def _ends_at_once(config: Path) -> list[str]:
    """A bridge that ends with 1; what it said."""
    log = config.with_name("daemon.log")
    before = log.read_text() if log.exists() else ""
    with Daemon(config) as second:
        assert second.process.wait(WAIT_S) == 1
    return log.read_text()[len(before) :].splitlines()


@contextmanager
def _undisturbed(port: int) -> Iterator[None]:
    """Assert that only pings are published meanwhile."""
    with MqttProbe(port, f"{BASE}/#") as probe:
        probe.wait_for(is_complete)
        probe.clear()
        yield
        told = {m.topic for m in probe.seen if not m.retain and "diagnostics" not in m.topic}
        assert told <= {f"{BASE}/bridge/ping"}


def test_one_bridge_a_base_topic(tmp_path: Path) -> None:
    """The second one ends with one line before it contacts the broker; then its turn may come."""
    with panel(LineProtocol.MODBUS_RTU) as line, broker(tmp_path) as mosquitto:
        config = write_config(tmp_path, line, mosquitto.port)
        with Daemon(config) as first:
            with _undisturbed(mosquitto.port):
                (said,) = _ends_at_once(config)
            assert said == (
                "wisco2mqtt: another bridge runs on this machine with the base topic wisco: "
                "stop that one first, or give this one another base_topic"
            )
            first.process.kill()
            first.process.wait(WAIT_S)
        with Daemon(config), MqttProbe(mosquitto.port, f"{BASE}/#") as probe:
            probe.wait_for(is_complete)


def test_one_bridge_a_gateway(tmp_path: Path) -> None:
    """One with another base topic neither gets the gateway, nor drops the connection of the first.

    A command is told who has it, too.
    """
    modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)]
    with (
        SimulatedLine(LineProtocol.WISCO, 9600, modules, endpoint=TcpEndpoint()) as line,
        broker(tmp_path) as mosquitto,
    ):
        config = write_config(tmp_path, line, mosquitto.port)
        other = tmp_path / "other.yaml"
        other.write_text(config.read_text().replace("mqtt: {", "mqtt: {base_topic: other, "))
        with Daemon(config), _undisturbed(mosquitto.port):
            (said,) = _ends_at_once(other)
            assert said == (
                f"wisco2mqtt: line main: {line.port}: another program holds it: stop that one first"
            )
            try:
                open_port(line.port.replace("127.0.0.1", "localhost"), 9600).close()
            except PortBusyError:
                return
        raise AssertionError("the gateway was opened twice")
