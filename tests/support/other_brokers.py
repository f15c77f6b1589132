"""Real brokers besides mosquitto: nats-server, and rabbitmq-server with its MQTT plugin.

Each is a process of its own on free loopback ports, ended by its own handle. Both speak MQTT 3.1.1
alone, and keep what is retained on disk: over a restart it is still there.
"""

import os
import shutil
import signal
import socket
import subprocess
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path

import pytest
from support.mosquitto import free_port

START_S = 60.0  # RabbitMQ takes 8 s where nothing else runs
# MQTT 3.1.1: CONNECT of client `probe` with a clean session, DISCONNECT; and CONNACK, accepted.
_CONNECT = b"\x10\x11\x00\x04MQTT\x04\x02\x00\x3c\x00\x05probe"
_DISCONNECT = b"\xe0\x00"
_CONNACK = b"\x20\x02\x00\x00"
_RABBITMQ = (
    "/usr/lib/rabbitmq/bin/rabbitmq-server"  # Debian's /usr/sbin one wants a user of its own
)


class OtherBroker(ABC):
    """One broker with a directory of its own. `start` and `stop` may alternate: same ports.

    Attributes:
        port: Its MQTT listener.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.port = free_port()
        self._processes: list[subprocess.Popen[bytes]] = []  # in the order of their start

    @abstractmethod
    def _commands(self) -> list[tuple[list[str], Mapping[str, str]]]:
        """Write what they read; return what to start, and in what environment; the broker last."""

    def start(self) -> None:
        """Starts it and returns when it accepts clients."""
        self.launch()
        self._wait_until_it_accepts()

    def launch(self) -> None:
        """Start it and do not wait: a node may need another one before it accepts clients."""
        self.directory.mkdir(parents=True, exist_ok=True)
        with (self.directory / "output").open("ab") as output:
            for command, environ in self._commands():
                self._processes.append(
                    subprocess.Popen(
                        command,
                        env={**os.environ, **environ},
                        cwd=self.directory,  # nats-server leaves files where it stands
                        stdin=subprocess.DEVNULL,
                        stdout=output,
                        stderr=subprocess.STDOUT,
                    )
                )

    def stop(self) -> None:
        """Ends it as an init system would. May be called twice."""
        while self._processes:
            process = self._processes.pop()
            process.terminate()
            process.wait(START_S)

    def kill(self) -> None:
        """Kill it, as a power cut would."""
        while self._processes:
            process = self._processes.pop()
            process.kill()
            process.wait(START_S)

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        for process in self._processes:
            process.send_signal(number)

    def restart(self) -> None:
        """Stops and starts it on the same ports."""
        self.stop()
        self.start()

    @property
    def log(self) -> str:
        """Return its output, for messages of failed tests."""
        return (self.directory / "output").read_text(errors="replace")

    def _wait_until_it_accepts(self) -> None:
        deadline = time.monotonic() + START_S
        while not self._accepts():
            broker = self._processes[-1]
            if broker.poll() is not None or time.monotonic() > deadline:
                pytest.fail(f"{broker.args!r} takes no clients ({broker.returncode}):\n{self.log}")
            time.sleep(0.02)  # a process tells nobody that it listens: it is asked again

    def _accepts(self) -> bool:
        # RabbitMQ listens a moment before it can take a client.
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=2) as client:
                client.sendall(_CONNECT)
                accepted = client.recv(4) == _CONNACK
                client.sendall(_DISCONNECT)
                return accepted
        except OSError:
            return False


class Nats(OtherBroker):
    """nats-server: MQTT over JetStream."""

    def _commands(self) -> list[tuple[list[str], Mapping[str, str]]]:
        config = self.directory / "nats.conf"
        if not config.exists():
            config.write_text(self._text())
        return [([_program("nats-server", "nats-server"), "-c", str(config)], {})]

    def _text(self) -> str:
        return (
            f'server_name: "{self.directory.name}"\n'
            f'host: "127.0.0.1"\nport: {free_port()}\n'
            f'jetstream {{ store_dir: "{self.directory}/store" }}\n'
            f'mqtt {{ host: "127.0.0.1", port: {self.port} }}\n'
        )


class RabbitMq(OtherBroker):
    """rabbitmq-server with its MQTT plugin: a node by itself, with a name server by itself."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory)
        self._names_port = free_port()
        self._node_port = free_port()

    def _commands(self) -> list[tuple[list[str], Mapping[str, str]]]:
        (self.directory / "plugins").write_text("[rabbitmq_mqtt].\n")
        (self.directory / "rabbitmq.conf").write_text(
            "listeners.tcp = none\n"
            f"mqtt.listeners.tcp.1 = 127.0.0.1:{self.port}\n"
            "mqtt.allow_anonymous = true\n"
            "log.console = true\nlog.file = false\n"
        )
        names = [_program("epmd", "rabbitmq-server"), "-port", f"{self._names_port}"]
        server = [_program(_RABBITMQ, "rabbitmq-server")]
        return [([*names, "-address", "127.0.0.1"], {}), (server, self._environ())]

    def _environ(self) -> Mapping[str, str]:
        folder = str(self.directory)
        return {
            "HOME": folder,  # its cookie
            "ERL_EPMD_PORT": f"{self._names_port}",
            "ERL_EPMD_ADDRESS": "127.0.0.1",
            "RABBITMQ_NODENAME": "house@localhost",
            "RABBITMQ_DIST_PORT": f"{self._node_port}",
            "RABBITMQ_MNESIA_BASE": f"{folder}/mnesia",
            "RABBITMQ_LOG_BASE": f"{folder}/log",
            "RABBITMQ_PID_FILE": f"{folder}/pid",
            "RABBITMQ_CONFIG_FILE": f"{folder}/rabbitmq.conf",
            "RABBITMQ_CONF_ENV_FILE": "/dev/null",
            "RABBITMQ_ENABLED_PLUGINS_FILE": f"{folder}/plugins",
            "RABBITMQ_SERVER_ADDITIONAL_ERL_ARGS": (
                "-kernel inet_dist_use_interface {127,0,0,1} +S 1:1 +sbwt none"
            ),
            "RUNNING_UNDER_SYSTEMD": "1",  # the script becomes the server, and their id is one
        }


def _program(name: str, package: str) -> str:
    found = shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")
    if found is None:
        pytest.fail(f"{name} is not installed (Debian: apt install {package})")
    return found
