"""Messages of any size on the broker: F15."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, is_complete, panel, results, write_config

from bridge.model import LineProtocol
from proofs import measured_bridge
from proofs.figures import Figure, Run, Scale, proof

MOST_GROWTH_BYTES = 8 << 20
LONGEST_STALL_S = 0.5
COMMAND = f"{BASE}/garage/do/1/set"
PATIENCE_S = 60.0


@dataclass(frozen=True, slots=True)
class _Life:
    """The measurements of a daemon.

    Attributes:
        peak_bytes: The most memory that it held.
        stall_s: The longest delay of its main or its MQTT thread.
        connects: How often it connected to the broker.
    """

    peak_bytes: int
    stall_s: float
    connects: int


class _House:
    """A broker as Debian configures it, a panel, and one daemon after the other.

    Attributes:
        port: The broker's.
    """

    def __init__(self, directory: Path, mosquitto: Mosquitto, protocol: str) -> None:
        self.port = mosquitto.port
        self._directory = directory
        self._protocol = protocol

    def live(self, sent: int = 0) -> _Life:
        """Runs a daemon; it gets a command of `sent` bytes. In the end one is carried out."""
        stalls = self._directory / "stalls"
        stalls.unlink(missing_ok=True)
        self._directory.joinpath("daemon.log").unlink(missing_ok=True)
        with panel(LineProtocol.MODBUS_RTU, paced=False) as line:
            config = write_config(self._directory, line, self.port)
            broker = f"port: {self.port}"
            text = config.read_text()
            config.write_text(text.replace(broker, f"{broker}, protocol: '{self._protocol}'"))
            with (
                MqttProbe(self.port, *_WATCHED) as probe,
                Daemon(config, program=(measured_bridge.__file__, str(stalls))) as daemon,
            ):
                probe.wait_for(is_complete, PATIENCE_S)
                if sent:
                    self.publish(COMMAND, sent)
                probe.publish(COMMAND, json.dumps({"state": "ON", "id": "last"}))
                probe.wait_for(_is_done, PATIENCE_S)
                return _Life(
                    _peak_bytes(daemon.process.pid),
                    float(stalls.read_text()),
                    daemon.log.count("connected to the broker"),
                )

    def publish(self, topic: str, size_bytes: int, *options: str) -> None:
        """Publishes a message of this size, from a process of its own."""
        payload = self._directory / "payload"
        payload.write_bytes(b"x" * size_bytes)
        command = ["mosquitto_pub", "-p", str(self.port), "-q", "1", "-t", topic, "-f"]
        subprocess.run([*command, str(payload), *options], check=True)


# Not those of the retained strangers, which the probe would hold.
_WATCHED = tuple(
    f"{BASE}/{topic}"
    for name in ("garage", "pumps")
    for topic in (name, f"{name}/availability", f"{name}/problem", f"{name}/result")
) + tuple(
    f"{BASE}/{topic}"
    for topic in (
        "bridge/state",
        "bridge/info",
        "bridge/line/main/availability",
        "garage/di/+",
        "garage/do/#",
        "pumps/do/#",
    )
)


def _is_done(seen: list[Seen]) -> bool:
    # Read while the burst was on its way, it may be stale; then it is asked again.
    return any(each.get("id") == "last" and each["status"] == "done" for each in results(seen))


def _peak_bytes(process: int) -> int:
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) << 10
    raise AssertionError("the kernel does not tell the peak")


def _trial(directory: Path, protocol: str, run: Run) -> list[_Life]:
    """A plain life, then one with a large command and one with large retained messages.

    In short one with both.
    """
    directory.mkdir()
    mosquitto = Mosquitto(directory / "mosquitto")
    mosquitto.start()
    house = _House(directory, mosquitto, protocol)
    large = run.scale.of(20_000_000, 200_000_000)
    try:
        lives = [house.live()]
        if run.scale is Scale.FULL:
            lives.append(house.live(large))
        for n in range(run.scale.of(4, 45)):  # they look like states of old stations
            topic = f"{BASE}/old{n}/do/1"
            house.publish(topic, run.scale.of(5_000_000, 20_000_000), "--retain")
        lives.append(house.live(large if run.scale is Scale.SHORT else 0))
    finally:
        mosquitto.stop()
    return lives


@proof("F15")
def large_messages_pass_by(run: Run) -> Figure:
    """Messages that are too large are dropped while they arrive, and the bridge works on."""
    told, kept = [], True
    for protocol in ("5", "3.1.1") if run.scale is Scale.FULL else ("3.1.1",):
        plain, *lives = _trial(run.directory / protocol, protocol, run)
        growth = [life.peak_bytes - plain.peak_bytes for life in lives]
        stall_s = max(life.stall_s for life in lives)
        grown = " and ".join(f"{one / (1 << 20):+.1f}" for one in growth)
        told.append(f"MQTT {protocol}: RSS {grown} MB, stall {stall_s:.2f} s")
        kept &= max(growth) <= MOST_GROWTH_BYTES and stall_s <= LONGEST_STALL_S
        kept &= all(life.connects == 1 for life in lives)
    size, count, each = run.scale.of(20, 200), run.scale.of(4, 45), run.scale.of(5, 20)
    return Figure(
        injected=f"one message of {size} MB; {count} retained ones of {each} MB",
        seen="; ".join(told),
        promised=f"RSS +8 MB, longest stall {LONGEST_STALL_S} s",
        kept=kept,
    )
