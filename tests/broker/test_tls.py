"""The TLS part of docs/broker/README.md, done word for word: what comes of it connects."""

import getpass
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe
from support.panel import BASE, is_complete, panel, results, write_config

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine

FOLDER = Path(__file__).parents[2] / "docs" / "broker"
GUIDE = (FOLDER / "README.md").read_text().split("## TLS")[1]
ACL = (FOLDER / "acl").read_text()
OWNER = {"owner": "o"}


def _blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", GUIDE, flags=re.MULTILINE | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Place:
    """A machine in a folder: what stands in the guide, with this test's names for its places."""

    root: Path
    broker: Mosquitto

    def here(self, text: str) -> str:
        """The guide's text, as it has to be on this machine."""
        assert self.broker.tls_port is not None
        for theirs, ours in {
            "sudo ": "",
            "-o mosquitto ": "",  # whoever runs the tests runs the broker
            "broker.home": "localhost",
            "/etc/mosquitto/": f"{self.broker.directory}/",
            "/etc/wisco2mqtt/": f"{self.root}/",
            "/run/credentials/wisco2mqtt.service/": f"{self.root}/",
            "listener 1883": f"listener {self.broker.port}",
            "8883": str(self.broker.tls_port),
        }.items():
            text = text.replace(theirs, ours)
        return text

    def run(self, script: str) -> str:
        """Runs commands of the guide as a reader would type them."""
        done = subprocess.run(
            ["bash", "-euc", self.here(script)],
            cwd=self.root,
            check=False,
            capture_output=True,
            text=True,
            timeout=30,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def configure_bridge(self, directory: Path, line: SimulatedLine, mqtt: str) -> Path:
        """Writes the bridge's configuration with this section `mqtt`."""
        path = write_config(directory, line, 0)
        lines = path.read_text().split("\n", 1)[1]
        # Modules of a busy machine may be slow: nothing here is about them.
        lines = lines.replace("    protocol:", "    timeout: 2s\n    protocol:")
        path.write_text(self.here(mqtt).replace("mqtts://localhost", self._url) + lines)
        return path

    @property
    def _url(self) -> str:
        return f"mqtts://localhost:{self.broker.tls_port}"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """The guide done up to the broker, which runs."""
    root = tmp_path_factory.mktemp("machine")
    # The broker's own configuration is not used: the guide's is.
    broker = Mosquitto(root / "mosquitto", users=OWNER, acl=ACL, tls=True)
    place = Place(root, broker)
    (broker.directory / "certs").mkdir(parents=True)
    make, to_broker, to_bridge, _look = _blocks("sh")
    place.run(make)
    place.run(to_broker)
    place.run(to_bridge)
    (broker.directory / "wisco2mqtt.acl").write_text(ACL)
    broker.password_file(OWNER).rename(broker.directory / "wisco2mqtt.passwd")
    started_by_us = f"user {getpass.getuser()}\n"
    (broker.directory / "mosquitto.conf").write_text(started_by_us + place.here(*_blocks("conf")))
    broker.start()
    yield place
    broker.stop()


@pytest.fixture
def line() -> Iterator[SimulatedLine]:
    """A panel."""
    with panel(LineProtocol.MODBUS_RTU) as simulated:
        yield simulated


def test_the_bridge_connects_with_its_certificate_and_works(
    place: Place, line: SimulatedLine, tmp_path: Path
) -> None:
    """No password: the name in the certificate is its user in the access list."""
    config = place.configure_bridge(tmp_path, line, *_blocks("yaml"))
    with (
        MqttProbe(
            place.broker.port, f"{BASE}/#", username="owner", password=OWNER["owner"]
        ) as owner,
        Daemon(config) as daemon,
    ):
        owner.wait_for(is_complete)
        owner.publish(f"{BASE}/garage/do/1/set", "ON")
        assert results(owner.wait_for(lambda seen: bool(results(seen))))[0]["status"] == "done"
        assert daemon.stop()[0] == 0
        assert "WARNING bridge.mqtt" not in daemon.log


def test_the_command_that_looks_without_the_bridge_connects(place: Place) -> None:
    """With the viewer's certificate; it sees what is retained."""
    with MqttProbe(place.broker.port, username="owner", password=OWNER["owner"]) as owner:
        owner.publish(f"{BASE}/garage/do/2", "ON", retain=True)
    look = _blocks("sh")[3].strip().replace("wisco/#", f"{BASE}/garage/do/2")
    assert place.run(f"{look} -C 1 -W 20") == f"{BASE}/garage/do/2 ON\n"


CLIENT = "    cert: {0}/client.crt\n    key: {0}/client.key\n"
# What is wrong in the section `tls`, and what the log says.
WRONG = {
    "no certificate": ("    ca: {0}/ca.crt\n", "certificate"),
    "another authority": ("    ca: {0}/ca/wisco.crt\n" + CLIENT, "certificate verify failed"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_one_line_of_the_log(
    place: Place, line: SimulatedLine, wrong: str, tmp_path: Path
) -> None:
    """The bridge goes on trying; the line says what the broker, or TLS, said."""
    tls, said = WRONG[wrong]
    section = f"mqtt:\n  url: mqtts://localhost\n  tls:\n{tls.format(place.root)}"
    with Daemon(place.configure_bridge(tmp_path, line, section)) as daemon:
        daemon.wait_for_log("online: DO100")
        daemon.wait_for_log(said)
        complaints = [row for row in daemon.log.splitlines() if "WARNING bridge.mqtt" in row]
        assert len(complaints) == 1, complaints
        assert "Traceback" not in daemon.log
