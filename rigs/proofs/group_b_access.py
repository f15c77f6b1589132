"""Access lists that deny in silence: B3."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe
from support.panel import BASE, panel, write_config

from bridge.model import LineProtocol
from proofs.figures import Figure, Run, proof

NAMED_WITHIN_S = 10.0
USERS = {"bridge": "b", "owner": "o"}


@dataclass(frozen=True, slots=True)
class Gap:
    """One thing that the list keeps from the bridge, and what the log must name.

    Attributes:
        rules: The bridge's own part of the list.
        named: What must stand in one line of the log.
        commanded: It shows only when a command is answered.
    """

    rules: tuple[str, ...]
    named: str
    commanded: bool = False


def _all_but(topic: str) -> tuple[str, ...]:
    return ("topic readwrite #", f"topic deny {topic}")


GAPS = {
    "states": Gap(_all_but(f"{BASE}/+/di/+"), f"{BASE}/garage/di/1"),
    "availability": Gap(_all_but(f"{BASE}/+/availability"), f"{BASE}/garage/availability"),
    "discovery": Gap(_all_but("homeassistant/#"), "homeassistant/device/"),
    "ping": Gap(_all_but(f"{BASE}/bridge/ping"), f"{BASE}/bridge/ping"),
    # It may publish everything, and the broker grants what it subscribes to.
    "commands": Gap(
        ("topic write #", f"topic read {BASE}/bridge/ping", f"topic read {BASE}/+/set"),
        f"{BASE}/+/do/+/set",
    ),
    "result": Gap(_all_but(f"{BASE}/+/result"), f"{BASE}/garage/result", commanded=True),
}


def _named_after_s(directory: Path, gap: Gap) -> float:
    """Return how long after the connect, or a command, the log names the gap; inf: never."""
    directory.mkdir()
    acl = "\n".join(["user owner", "topic readwrite #", "user bridge", *gap.rules, ""])
    mosquitto = Mosquitto(directory / "mosquitto", users=USERS, acl=acl)
    mosquitto.start()
    with panel(LineProtocol.MODBUS_RTU) as line:
        path = write_config(directory, line, mosquitto.port)
        text = path.read_text()
        path.write_text(text.replace("mqtt: {", "mqtt: {username: bridge, password: b, "))
        with Daemon(path) as daemon:
            daemon.wait_for_log("connected to the broker")
            daemon.wait_for_log("online: DO100")
            if gap.commanded:
                with MqttProbe(mosquitto.port, username="owner", password="o") as owner:  # noqa: S106  # a test's
                    owner.publish(f"{BASE}/garage/do/1/set", "ON")
            began = time.monotonic()
            while not _is_named(daemon.log, gap.named):
                if time.monotonic() > began + NAMED_WITHIN_S:
                    return float("inf")
                time.sleep(0.02)  # a file tells nobody that it grew: it is looked at again
            took_s = time.monotonic() - began
    mosquitto.stop()
    return took_s


def _is_named(log: str, name: str) -> bool:
    return any(name in line for line in log.splitlines() if "WARNING" in line or "ERROR" in line)


@proof("B3")
def denials_are_named(run: Run) -> Figure:
    """The log names each topic that an access list denies to the bridge."""
    directories = [run.directory / name for name in GAPS]
    with ThreadPoolExecutor() as pool:
        took = dict(zip(GAPS, pool.map(_named_after_s, directories, GAPS.values()), strict=True))
    silent = [name for name, after_s in took.items() if after_s > NAMED_WITHIN_S]
    named = len(took) - len(silent)
    slowest_s = max((t for t in took.values() if t <= NAMED_WITHIN_S), default=0.0)
    return Figure(
        injected=f"{len(GAPS)} gaps in the access list: {', '.join(GAPS)}",
        seen=f"{named} named, the slowest after {slowest_s:.1f} s"
        + (f"; not {', '.join(silent)}" if silent else ""),
        promised=f"each named in the log within {NAMED_WITHIN_S:.0f} s",
        kept=not silent,
    )
