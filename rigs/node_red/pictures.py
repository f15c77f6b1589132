"""Takes the pictures of docs/node-red/: the example flows in the editor, in a running house.

`make node-red-pictures` calls it; Debian's chromium draws.
"""

import subprocess
import tempfile
from pathlib import Path

from support.daemon import Daemon
from support.mqtt_probe import MqttProbe
from support.panel import BASE, broker, is_complete, panel, write_config

from bridge.model import LineProtocol
from node_red.debug_sidebar import DebugSidebar
from node_red.flows import FOLDER, at_broker, everything
from node_red.node_red import NodeRed

TABS = ("wisco-outputs", "wisco-alarm")
SIZE = "1440,660"
DRAWN_WITHIN_MS = 15_000


def main() -> None:
    """Presses a button of each kind, so that the nodes have something to show."""
    with (
        tempfile.TemporaryDirectory() as name,
        panel(LineProtocol.WISCO) as line,
        broker(Path(name)) as mosquitto,
        NodeRed(Path(name) / "node-red") as node_red,
        MqttProbe(mosquitto.port, f"{BASE}/#") as probe,
    ):
        line.module(1).set_mode(2, pulse=True, hold_s=0.5)
        with Daemon(write_config(Path(name), line, mosquitto.port)):
            probe.wait_for(is_complete)
            node_red.deploy(at_broker(everything(), mosquitto.port))
            with DebugSidebar(node_red.port) as sidebar:
                probe.wait_for(lambda _: "Connected to broker" in node_red.log)
                for example, button in (("lamp", "on"), ("several", "some"), ("gate", "press")):
                    node_red.press(f"wisco-outputs-{example}-{button}")
                    sidebar.wait_for(f"wisco-outputs-{example}-done")
            for tab in TABS:
                _draw(f"http://127.0.0.1:{node_red.port}/#flow/{tab}", FOLDER / f"{tab}.png")


def _draw(url: str, path: Path) -> None:
    subprocess.run(
        [
            *("chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"),
            f"--window-size={SIZE}",
            f"--virtual-time-budget={DRAWN_WITHIN_MS}",
            f"--screenshot={path}",
            url,
        ],
        check=True,
        stderr=subprocess.DEVNULL,
        timeout=120,
    )


if __name__ == "__main__":
    main()
