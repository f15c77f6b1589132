"""A house with a panel: simulated modules, a broker, the bridge in a process of its own."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from support.daemon import Daemon
from support.mosquitto import Mosquitto, free_port

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import SimulatedLine, SimulatedModule

PASSWORD = "open sesame"  # noqa: S105  # of a house that is not there
_HOUSE = """\
mqtt: {{host: 127.0.0.1, port: {broker}}}
state_dir: {directory}
web: {{listen: "127.0.0.1:{web}"{keys}}}
{lines}"""
# The port of the simulated line among those that the panel offers.
WITH_PORT = """\
import sys
from bridge.cli.main import main
from bridge.transport import ports
ports.serial_ports = lambda: [ports.FoundPort({port!r}, "Simulated RS485 adapter")]
sys.exit(main(sys.argv[1:]))
"""
LINES = """\
lines:
  - id: main
    port: {port}
    baud: 9600
    protocol: wisco
    stations:
      - address: 1
        model: DIO100
        id: garage
        name: Garage
        area: Yard
        interlock: [[4, 5]]
        covers: {{shutter: {{name: Shutter, open: 6, close: 7, open_time: 20s, close_time: 18s}}}}
        inputs: {{1: {{name: Door}}, 2: {{name: Motion}}, 4: {{name: Water meter, count: true}}}}
        outputs:
          1: {{name: Lamp}}
          2: {{name: Gate}}
          3: {{name: Siren, read_only: true}}
          4: {{name: Pump up}}
          5: {{name: Pump down}}
      - {{address: 2, model: DO100, id: pumps, name: Pumps of the garden with a long name}}
      - {{address: 9, model: DIO100, id: dead, name: Shed}}
"""


@dataclass
class PanelHouse:
    """All of it. `web` is the port of the panel."""

    line: SimulatedLine
    broker: Mosquitto
    daemon: Daemon
    web: int
    config: Path

    @property
    def url(self) -> str:
        """Return where the panel is."""
        return f"http://127.0.0.1:{self.web}/"

    def send(self, data: bytes) -> bytes:
        """Send bytes, and return what comes until the panel closes."""
        with socket.create_connection(("127.0.0.1", self.web), timeout=30) as client:
            answer = b""
            try:
                client.sendall(data)
                while piece := client.recv(65536):
                    answer += piece
            except (ConnectionResetError, BrokenPipeError):
                pass
            return answer

    @property
    def module(self) -> SimulatedModule:
        """Return the module of the garage."""
        return self.line.module(1)


@contextmanager
def panel_house(
    directory: Path, *, lines: str = LINES, keys: str = "", broker: Mosquitto | None = None
) -> Iterator[PanelHouse]:
    """Start everything; `keys` are further keys of `web`, `lines` the end of the file.

    Without `lines` the modules have addresses, a baud rate and a protocol that no file tells.
    """
    wisco = LineProtocol.WISCO, 9600, (1, 2)
    protocol, baud, (first, second) = wisco if lines else (LineProtocol.MODBUS_RTU, 19200, (7, 12))
    modules = [SimulatedModule(DIO100, first), SimulatedModule(DO100, second)]
    modules[0].set_mode(2, pulse=True, hold_s=0.5)
    directory.mkdir(exist_ok=True)
    with ExitStack() as stack:
        line = SimulatedLine(protocol, baud, modules)
        stack.enter_context(line)
        if broker is None:
            broker = Mosquitto(directory / "broker")
            stack.callback(broker.stop)
            broker.start()
        web, config = free_port(), directory / "config.yaml"
        config.write_text(
            _HOUSE.format(
                broker=broker.port,
                directory=directory,
                web=web,
                keys=keys,
                lines=lines.format(port=line.port),
            )
        )
        program = ("-c", WITH_PORT.format(port=line.port))
        daemon = stack.enter_context(Daemon(config, program=program))
        daemon.wait_for_log("the panel listens")
        if lines:
            daemon.wait_for_log("online: DO100")
        yield PanelHouse(line, broker, daemon, web, config)
        daemon.stop()
