"""One Debian: the package from install to purge, with modules on a line and a broker."""

import json
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from support.mqtt_probe import MqttProbe

from bridge import __version__
from bridge.model import DIO100, DO100
from bridge.simulator import SimulatedLine, SimulatedModule
from bridge.simulator.tcp import TcpEndpoint
from packages.machine import Machine
from packages.panel import save_lines

BROKER_PORT, GATEWAY_PORT, PANEL_PORT = 1883, 4196, 8099
UNIT = "wisco2mqtt.service"
CONFIG = "/etc/wisco2mqtt/config.yaml"
_LINES = f"""\
lines:
  - id: main
    port: tcp://127.0.0.1:{GATEWAY_PORT}
    baud: 9600
    protocol: wisco
    stations:
      - {{address: 1, model: DIO100, id: garage, outputs: {{1: {{name: Lamp}}}}}}
      - {{address: 2, model: DO100, id: pumps}}
"""
_SOURCE = """\
Types: deb
URIs: file:/srv/{name}
Suites: stable
Components: main
Signed-By: /srv/{name}/wisco2mqtt.gpg
"""

Check = Callable[[bool, str], None]


class Trial:
    """The owner of one machine, from `apt install` to `apt purge`."""

    def __init__(self, machine: Machine, check: Check) -> None:
        self._machine = machine
        self._check = check
        self._modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)]

    def run(self, before: Path, now: Path) -> None:
        """Goes through all of it; `before` and `now` are repositories."""
        for name, repository in (("before", before), ("now", now)):
            shutil.copytree(repository, self._machine.root / "srv" / name)
        with self._machine:
            self._use("before")
            untouched = self._machine.files()
            self._install()
            endpoint = TcpEndpoint(GATEWAY_PORT)
            with (
                SimulatedLine("wisco", 9600, self._modules, endpoint=endpoint),
                MqttProbe(BROKER_PORT, "wisco/#", "homeassistant/#") as probe,
            ):
                self._configure(probe)
                self._switch(probe)
                self._upgrade(probe)
                self._remove()
            left = sorted(self._machine.files() - untouched)
            self._check(not left, f"files left after purge: {', '.join(left) or 'none'}")
            gone = sorted(untouched - self._machine.files())
            self._check(not gone, f"files of others gone: {', '.join(gone) or 'none'}")

    def _use(self, name: str) -> None:
        folder = self._machine.root / "etc" / "apt"
        (folder / "sources.list").write_text("")
        (folder / "sources.list.d" / "wisco2mqtt.sources").write_text(_SOURCE.format(name=name))
        self._machine.run("apt-get update")

    def _install(self) -> None:
        machine = self._machine
        machine.run("apt-get install -y wisco2mqtt")
        version = machine.run("wisco2mqtt --version").strip()
        self._check(bool(version), f"installed: {version}")
        enabled = machine.run("systemctl is-enabled wisco2mqtt", expect=None).strip()
        self._check(enabled == "enabled", f"the unit is {enabled}")
        self._first_start()
        self._attack()
        for path in (
            "man/man1/wisco2mqtt-send.1.gz",
            "bash-completion/completions/wisco2mqtt",
            "zsh/vendor-completions/_wisco2mqtt",
            "fish/vendor_completions.d/wisco2mqtt.fish",
            "doc/wisco2mqtt/examples/config.example.yaml",
        ):
            self._check((machine.root / "usr/share" / path).exists(), f"/usr/share/{path}")

    def _first_start(self) -> None:
        """It runs, with the panel alone."""
        state = self._machine.shown(UNIT, "ActiveState")
        self._check(state == "active", f"the first start: {state}, without a line")
        checked = self._machine.run(f"cd /; wisco2mqtt check -c {CONFIG} 2>&1", expect=None)
        self._check("is valid" in checked, f"check: {checked.strip().splitlines()[-1]}")

    def _attack(self) -> None:
        """A captured service gets no file of root: systemd reads this one for it, as root."""
        kept = "/etc/wisco2mqtt/mqtt-password"
        service = "setpriv --reuid=wisco2mqtt --regid=wisco2mqtt --clear-groups"
        for command in ("ln -sfT /etc/shadow", "mv -fT /etc/wisco2mqtt/config.yaml", "rm -f"):
            self._machine.run(f"{service} {command} {kept}", expect=None)
        there = self._machine.run(f"stat -c '%U %a %F' {kept}").strip()
        self._check(there == "root 600 regular empty file", f"after an attack {kept}: {there}")

    def _configure(self, probe: MqttProbe) -> None:
        """The owner adds a line in the panel, and saves."""
        save_lines(_LINES, PANEL_PORT)
        probe.wait_message("wisco/garage/availability", "online")
        probe.wait_message("wisco/pumps/availability", "online")
        entities = {
            seen.topic: len(json.loads(seen.payload)["components"])
            for seen in probe.seen
            if seen.topic.startswith("homeassistant/device/") and seen.payload
        }
        told = ", ".join(f"{topic.split('/')[2]} {count}" for topic, count in entities.items())
        wanted = {f"homeassistant/device/wisco__{name}/config" for name in ("garage", "pumps")}
        self._check(wanted <= entities.keys(), f"saved in the panel; entities on mosquitto: {told}")
        self._machine.run("systemctl reload wisco2mqtt")
        restarts = self._machine.shown(UNIT, "NRestarts")
        self._check(restarts == "0", f"restarted by itself {restarts} times")

    def _switch(self, probe: MqttProbe) -> None:
        for topic in ("garage/do/1", "pumps/do/16"):
            probe.publish(f"wisco/{topic}/set", "ON")
            probe.wait_message(f"wisco/{topic}", "ON")
        self._check(self._orders() == {"1/1 ON": 1, "2/16 ON": 1}, f"ordered: {self._orders()}")

    def _upgrade(self, probe: MqttProbe) -> None:
        before, orders, settings = self._main_pid(), self._orders(), CONFIG.removeprefix("/")
        configured = (self._machine.root / settings).read_text()
        self._use("now")
        probe.clear()
        self._machine.run("apt-get install -y wisco2mqtt")
        probe.wait_message("wisco/garage/availability", "online")
        version = self._machine.run("wisco2mqtt --version").strip()
        self._check(version.endswith(__version__), f"upgraded: {version}")
        self._check(before != self._main_pid() != "0", "the service was restarted")
        infos = [json.loads(seen.payload) for seen in probe.seen if "info" in seen.topic]
        self._check(infos[-1]["version"] == __version__, f"and is {infos[-1]['version']}")
        self._check(orders == self._orders(), f"orders by the upgrade: {self._since(orders)}")
        self._check(self._are_on(), "both relays are ON as before")
        kept = (self._machine.root / settings).read_text() == configured
        self._check(kept, "the configuration is as it was")

    def _remove(self) -> None:
        orders = self._orders()
        self._machine.run("apt-get remove -y wisco2mqtt")
        there = (self._machine.root / CONFIG.removeprefix("/")).exists()
        self._check(there, f"after remove {CONFIG} is there")
        gone = self._machine.run("grep -la 'bin/wisco[2]mqtt' /proc/[0-9]*/cmdline || true").split()
        self._check(not gone, f"after remove {len(gone)} processes run")
        self._check(orders == self._orders(), f"orders by the removal: {self._since(orders)}")
        self._check(self._are_on(), "both relays are ON as before")
        self._machine.run("apt-get purge -y wisco2mqtt")

    def _main_pid(self) -> str:
        return self._machine.shown(UNIT, "MainPID")

    def _orders(self) -> Counter[str]:
        """Returns what frames ordered, counted by the modules themselves."""
        return Counter(
            {
                f"{module.address}/{output} {'ON' if value else 'OFF'}": count
                for module in self._modules
                for (output, value), count in module.ordered.items()
            }
        )

    def _since(self, orders: Counter[str]) -> int:
        return (self._orders() - orders).total()

    def _are_on(self) -> bool:
        return all(
            module.outputs >> (channel - 1) & 1
            for module, channel in zip(self._modules, (1, 16), strict=True)
        )
