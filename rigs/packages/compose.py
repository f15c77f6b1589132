"""The compose file, run by podman-compose with the image that image.py built (root)."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml
from support.listening import wait_until_it_listens
from support.mqtt_probe import MqttProbe

from bridge.model import DIO100, DO100
from bridge.simulator import SimulatedLine, SimulatedModule
from bridge.simulator.tcp import TcpEndpoint
from packages import image
from packages.image import BASE, FOLDER, GATEWAY_PORT, LIMITS, LINES, PODMAN, check, podman
from packages.panel import save_lines
from packages.shell import run

_INSIDE = "--inside"  # of a network of our own: broker and panel have their usual ports there
_PASSWORD = "open sesame"  # noqa: S105  # of a house that is not there
# What the image of that name has, as far as compose.yaml asks for it.
_MOSQUITTO = f"""\
FROM {BASE}
RUN apt-get update && apt-get install --yes --no-install-recommends mosquitto \\
    && install -d -o 1883 -g 1883 /mosquitto/data /mosquitto/config
ENTRYPOINT ["mosquitto", "-c", "/mosquitto/config/mosquitto.conf"]
"""
_NEEDS_AN_ADAPTER = ("devices", "group_add")
_PATIENCE_S = 30.0


def main(arguments: Sequence[str]) -> int:
    """Returns 0 where nothing is wrong."""
    if _INSIDE in arguments:
        with TemporaryDirectory() as name:
            _Trial(Path(name) / "wisco2mqtt").run()
        return 1 if image.wrong else 0
    if shutil.which("podman-compose") is None:
        raise SystemExit("this needs podman-compose (Debian: apt-get install podman-compose)")
    with TemporaryDirectory() as name:
        (Path(name) / "Dockerfile").write_text(_MOSQUITTO)
        tag = _services()["mosquitto"]["image"]
        image.buildah("bud", "-q", "--isolation=chroot", "--layers=false", "--tag", tag, name)
    return image.in_a_network_of_its_own("packages.compose", _INSIDE)


def _services() -> dict[str, Any]:
    return dict(yaml.safe_load((FOLDER / "compose.yaml").read_text())["services"])


class _Trial:
    """A folder as docs/install.md has it copied."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)]

    def run(self) -> None:
        """Goes through all of it."""
        self._copy()
        endpoint = TcpEndpoint(GATEWAY_PORT)
        with SimulatedLine("wisco", 9600, self._modules, endpoint=endpoint):
            try:
                self._compose("up", "-d")
                self._look()
            finally:
                self._compose("down", "--volumes")

    def _copy(self) -> None:
        shutil.copytree(FOLDER, self._folder)
        document = yaml.safe_load((self._folder / "compose.yaml").read_text())
        for key in _NEEDS_AN_ADAPTER:
            del document["services"]["wisco2mqtt"][key]
        (self._folder / "compose.yaml").write_text(yaml.safe_dump(document))
        run("chown", "-R", "10001", str(self._folder / "config"))
        (self._folder / ".env").write_text(f"PANEL_PASSWORD={_PASSWORD}\n")
        wrapper = self._folder / "podman"
        wrapper.write_text(f'#!/bin/sh\nexec {" ".join(PODMAN)} "$@"\n')
        wrapper.chmod(0o755)

    def _compose(self, *words: str) -> None:
        limits = f"--podman-run-args={' '.join(LIMITS)}"
        command = ("podman-compose", "--podman-path", str(self._folder / "podman"), limits, *words)
        done = subprocess.run(
            command, cwd=self._folder, capture_output=True, text=True, check=False
        )
        check(done.returncode == 0, f"podman-compose {' '.join(words)} ends with {done.returncode}")
        if done.returncode:
            print(done.stdout, done.stderr)

    def _look(self) -> None:
        gateway = self._let_containers_reach_the_line()
        wait_until_it_listens(8099, _PATIENCE_S)
        save_lines(LINES.format(host=gateway, port=GATEWAY_PORT), 8099, _PASSWORD)
        with MqttProbe(1883, "wisco/#") as probe:
            probe.wait_message("wisco/pumps/availability", "online", _PATIENCE_S)
            check(True, "lines saved in the panel; both modules are online on its mosquitto")
            probe.publish("wisco/garage/do/1/set", "ON")
            probe.wait_message("wisco/garage/do/1", "ON")
            started = _started(probe)
        orders = self._modules[0].ordered.copy()
        self._compose("restart")
        wait_until_it_listens(1883, _PATIENCE_S)
        with MqttProbe(1883, "wisco/#") as probe:
            probe.wait_for(lambda _: _started(probe) not in {"", started}, _PATIENCE_S)
            probe.wait_message("wisco/garage/availability", "online", _PATIENCE_S)
            probe.wait_message("wisco/garage/do/1", "ON")
        same = self._modules[0].ordered == orders and self._modules[0].outputs & 1
        check(bool(same), "restarted, it ordered nothing, and the lamp is ON as before")

    def _let_containers_reach_the_line(self) -> str:
        """Returns where the host is for them; what comes there goes on to the modules' loopback."""
        (network,) = json.loads(podman("network", "inspect", f"{self._folder.name}_default").stdout)
        gateway = str(network["subnets"][0]["gateway"])
        Path("/proc/sys/net/ipv4/conf/all/route_localnet").write_text("1")
        line = ("--protocol", "tcp", "--destination", gateway, "--dport", str(GATEWAY_PORT))
        there = ("--jump", "DNAT", "--to-destination", "127.0.0.1")
        run("iptables", "--table", "nat", "--insert", "PREROUTING", *line, *there)
        return gateway


def _started(probe: MqttProbe) -> str:
    """Returns since when the bridge runs that told of itself last."""
    told = [seen for seen in probe.seen if seen.topic == "wisco/bridge/info"]
    return str(json.loads(told[-1].payload)["started"]) if told else ""


if __name__ == "__main__":
    os.umask(0o022)
    sys.exit(main(sys.argv[1:]))
