"""The panel, a broker, and a relay between the broker and the bridge, for failures of that link."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from support.brokers import Broker
from support.daemon import Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, STATIONS, broker, is_complete, panel, write_config
from support.tcp_relay import TcpRelay

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Switching

# Connects again after moments where the bridge itself would wait for a second.
IMPATIENT = Path(__file__).with_name("impatient_bridge.py")
ENVIRON = {"PYTHONPATH": str(IMPATIENT.parents[2])}


@dataclass(frozen=True, slots=True)
class RelayedPanel:
    """What stands around a daemon.

    Attributes:
        line: The modules.
        mosquitto: The broker.
        relay: What the daemon takes for the broker.
        config: The daemon's configuration.
        orders: Every order to any output, with the station id, in the order of the wire.
    """

    line: SimulatedLine
    mosquitto: Broker
    relay: TcpRelay
    config: Path
    orders: list[tuple[str, Switching]]

    def daemon(self, *, impatient: bool = False) -> Daemon:
        """The bridge, not started yet."""
        if not impatient:
            return Daemon(self.config)
        return Daemon(self.config, program=(str(IMPATIENT),), environ=ENVIRON)

    def wait_until_complete(self) -> None:
        """Waits until the bridge has published everything, and everything is online."""
        with MqttProbe(self.mosquitto.port, f"{BASE}/#") as probe:
            probe.wait_for(is_complete)


@contextmanager
def relayed_panel(directory: Path, *, mqtt: str = "auto") -> Iterator[RelayedPanel]:
    """Stands until the end of the block; `mqtt` is the protocol that the bridge speaks."""
    directory.mkdir(exist_ok=True)
    orders: list[tuple[str, Switching]] = []
    names = {address: name for name, (address, _) in STATIONS.items()}

    def note(address: int, switching: Switching) -> None:
        orders.append((names[address], switching))

    with (
        panel(LineProtocol.MODBUS_RTU, note) as line,
        broker(directory) as mosquitto,
        TcpRelay(mosquitto.port) as relay,
    ):
        config = write_config(directory, line, relay.port)
        text = config.read_text()
        config.write_text(text.replace("host: 127.0.0.1", f'host: 127.0.0.1, protocol: "{mqtt}"'))
        yield RelayedPanel(line, mosquitto, relay, config, orders)
