"""Operation: E6 a bad file at SIGHUP, E7 secrets. The real daemon, a real broker."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from support.daemon import WAIT_S, Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, broker, is_complete, panel, write_config

from bridge.model import LineProtocol
from proofs.figures import Figure, Run, proof
from proofs.systemd_socket import systemd_socket, wait_ready

# --- E6 ---------------------------------------------------------------------------------------

BAD_FILES = sorted((Path(__file__).parents[2] / "tests" / "config" / "bad").glob("*.yaml"))


@proof("E6")
def bad_files_are_reloaded(run: Run) -> Figure:
    """A wrong file is refused completely at a reload, and the old configuration runs on."""
    files = BAD_FILES[: run.scale.of(3, len(BAD_FILES))]
    with (
        panel(LineProtocol.MODBUS_RTU) as line,
        broker(run.directory) as mosquitto,
        systemd_socket(run.directory) as systemd,
    ):
        config = write_config(run.directory, line, mosquitto.port)
        good = config.read_text()
        with (
            MqttProbe(mosquitto.port, f"{BASE}/#") as probe,
            Daemon(config, notify=systemd) as daemon,
        ):
            probe.wait_for(is_complete)
            wait_ready(systemd)
            probe.clear()
            for n, bad in enumerate(files):
                config.write_bytes(bad.read_bytes())
                daemon.signal(signal.SIGHUP)
                wait_ready(systemd)
                line.module(1).toggle_input(1)
                _wait_for_changes(probe, n + 1)
            config.write_text(good)
            daemon.signal(signal.SIGHUP)
            wait_ready(systemd)
            ended = daemon.process.poll() is not None
            offline = sum(message.payload == b"offline" for message in probe.seen)
            connects = daemon.log.count("connected to the broker")
            changes = _changes(probe.seen)
    return Figure(
        injected=f"{len(files)} bad files, SIGHUP after each",
        seen=f"{offline} offline, {connects - 1} reconnects, {changes} of {len(files)} states",
        promised="0 offline, 0 reconnects, every state",
        kept=not (ended or offline) and connects == 1 and changes == len(files),
    )


def _wait_for_changes(probe: MqttProbe, count: int) -> None:
    probe.wait_for(lambda seen: _changes(seen) >= count)


def _changes(seen: list[Seen]) -> int:
    return sum(message.topic == f"{BASE}/garage/di/1" for message in seen)


# --- E7 ---------------------------------------------------------------------------------------

SECRET = "kumquat-7-marmalade"  # noqa: S105  # it is looked for where it must not be
ADMIN, ADMIN_PASSWORD = "admin", "another-one"
WAYS = {  # how the password comes into the configuration
    "literal": SECRET,
    "env": "!env WISCO_MQTT_PASSWORD",
    "file": "!file secret",
}
ENVIRON = {"WISCO_MQTT_PASSWORD": SECRET}
# Files with a problem beside the password, or where the password should be.
SPOILT = (
    ("password: ", "pasword: "),
    ("password: ", "password: [1, "),
    ("host: 127.0.0.1", "host: 127.0.0.1, host: 127.0.0.2"),
    ("protocol: modbus-rtu", "protocol: modbus"),
    ("username: wisco", "username: [wisco]"),
)


def _told(run: Run, way: str, *, accepted: bool) -> Iterator[str]:
    """Everything that the bridge says of itself, in one house."""
    directory = run.directory / f"{way}-{accepted}"
    directory.mkdir()
    (directory / "secret").write_text(SECRET + "\n")
    users = {ADMIN: ADMIN_PASSWORD, "wisco": SECRET if accepted else "not-this-one"}
    mosquitto = Mosquitto(directory / "mosquitto", users=users)
    mosquitto.start()
    try:
        with panel(LineProtocol.MODBUS_RTU) as line:
            config = write_config(directory, line, mosquitto.port)
            text = config.read_text().replace(
                "mqtt: {", f"mqtt: {{username: wisco, password: {WAYS[way]}, "
            )
            config.write_text(text)
            yield from _of_the_daemon(config, mosquitto.port, accepted=accepted)
    finally:
        mosquitto.stop()


def _of_the_daemon(config: Path, port: int, *, accepted: bool) -> Iterator[str]:
    probe = MqttProbe(port, "#", username=ADMIN, password=ADMIN_PASSWORD)
    good = config.read_text()
    with (
        probe,
        systemd_socket(config.parent) as systemd,
        Daemon(config, "--log-level", "debug", environ=ENVIRON, notify=systemd) as daemon,
    ):
        wait_ready(systemd)
        # Unless the password was used, nothing was proved.
        daemon.wait_for_log("connected to the broker" if accepted else "refuses user 'wisco'")
        if accepted:
            probe.wait_for(is_complete)
        for old, new in SPOILT:
            assert old in good
            config.write_text(good.replace(old, new))
            daemon.signal(signal.SIGHUP)
            wait_ready(systemd)
        config.write_text(good)
        yield from _of_commands(config)
        daemon.stop()
        yield daemon.log
        yield from (f"{message.topic} {message.payload!r}" for message in probe.seen)


def _of_commands(config: Path) -> Iterator[str]:
    send = ["send", "garage", "do/1", "ON", "--timeout", "1", "--deadline", "0.1"]
    for arguments in (["check"], send):
        ended = subprocess.run(
            [sys.executable, "-m", "bridge", "-c", str(config), "--log-level", "debug", *arguments],
            env={**os.environ, **ENVIRON},
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )
        yield ended.stdout + ended.stderr


@proof("E7")
def a_password_is_used(run: Run) -> Figure:
    """A password reaches the broker, and is published nowhere."""
    ways = list(WAYS)[: run.scale.of(1, len(WAYS))]
    told = [
        text
        for way in ways
        for accepted in (True, False)
        for text in _told(run, way, accepted=accepted)
    ]
    leaks = [text for text in told if SECRET in text]
    print("\n".join(leaks), end="")
    return Figure(
        injected=f"password by {', '.join(ways)}; right and wrong; log at debug",
        seen=f"{len(leaks)} leaks in {sum(map(len, told)) // 1024} KiB of log, topics, output",
        promised="0 leaks",
        kept=not leaks,
    )
