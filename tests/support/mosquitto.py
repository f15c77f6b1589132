"""A real mosquitto on free loopback ports: started, stopped and restarted by its own handle."""

import getpass
import os
import random
import shutil
import socket
import subprocess
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from support.certificates import make_certificates

START_S = 20.0  # generous: the machine may be busy


_PORTS = range(10_000, 30_000)
_PROCESSES = 8  # that run tests side by side
_chance = random.SystemRandom()
# A broker that is stopped for a moment does not listen on its port.
_given: deque[int] = deque(maxlen=500)
_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))


def free_port() -> int:
    """Returns a loopback port that nobody listens on just now.

    Below the range of outgoing connections: one of those could take the port of a broker that
    is stopped for a moment, and a client that knocks there could meet itself. Each process that
    runs tests side by side with others has ports of its own, and draws them by chance: the
    seed is the same in all of them. A port that was given lately is not given again.
    """
    while True:
        port = _chance.choice(_PORTS[_worker % _PROCESSES :: _PROCESSES])
        if port in _given:
            continue
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        _given.append(port)
        return port


def find_mosquitto() -> str:
    """Returns the broker's path. Without one, tests fail in CI and are skipped elsewhere."""
    found = shutil.which(
        "mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin"
    )
    if found is not None:
        return found
    if os.environ.get("CI") == "true":
        pytest.fail("mosquitto is not installed, and CI must run these tests")
    pytest.skip("mosquitto is not installed (Debian: apt install mosquitto)")


class Mosquitto:
    """One broker with a directory of its own. `start` and `stop` may alternate: same ports.

    Attributes:
        port: Its plain listener.
        tls_port: Its TLS listener, where `tls` asked for one: certificates are in `directory`.
    """

    def __init__(
        self,
        directory: Path,
        *,
        users: Mapping[str, str] | None = None,
        acl: str | None = None,
        persistence: bool = False,
        tls: bool = False,
        options: Sequence[str] = (),
    ) -> None:
        self.directory = directory
        self.port = free_port()
        self.tls_port = free_port() if tls else None
        self._users = users
        self._acl = acl
        self._persistence = persistence
        self._options = options
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Starts it and returns when it accepts connections."""
        program = find_mosquitto()
        self.directory.mkdir(parents=True, exist_ok=True)
        config = self.directory / "mosquitto.conf"
        if not config.exists():
            config.write_text("\n".join(self._configuration()) + "\n")
        with (self.directory / "output").open("ab") as output:
            self._process = subprocess.Popen(
                [program, "-c", str(config)], stdout=output, stderr=subprocess.STDOUT
            )
        self._wait_until_it_accepts()

    def stop(self) -> None:
        """Ends it as an init system would. May be called twice."""
        self._end(kill=False)

    def kill(self) -> None:
        """Kill it, as a power cut would."""
        self._end(kill=True)

    def restart(self) -> None:
        """Stops and starts it on the same ports."""
        self.stop()
        self.start()

    @property
    def log(self) -> str:
        """Return its output, for messages of failed tests."""
        return "".join(
            path.read_text(errors="replace")
            for path in (self.directory / "output", self.directory / "mosquitto.log")
            if path.exists()
        )

    def _end(self, *, kill: bool) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        if kill:
            process.kill()
        else:
            process.terminate()
        process.wait(START_S)

    def _configuration(self) -> list[str]:
        lines = [
            # Started by root it would change to a user that cannot read our files.
            f"user {getpass.getuser()}",
            f"log_dest file {self.directory}/mosquitto.log",
            "log_type all",
            f"persistence {str(self._persistence).lower()}",
            f"persistence_location {self.directory}/",
            f"allow_anonymous {str(self._users is None).lower()}",
            f"listener {self.port} 127.0.0.1",
        ]
        if self.tls_port is not None:
            make_certificates(self.directory)
            lines += [
                f"listener {self.tls_port} 127.0.0.1",
                f"cafile {self.directory}/ca.crt",
                f"certfile {self.directory}/server.crt",
                f"keyfile {self.directory}/server.key",
            ]
        if self._users is not None:
            lines.append(f"password_file {self.password_file(self._users)}")
        if self._acl is not None:
            (self.directory / "acl").write_text(self._acl)
            lines.append(f"acl_file {self.directory}/acl")
        return [*lines, *self._options]

    def password_file(self, users: Mapping[str, str]) -> Path:
        """Writes a password file for these users."""
        path = self.directory / "passwords"
        path.write_text("".join(f"{user}:{password}\n" for user, password in users.items()))
        subprocess.run(["mosquitto_passwd", "-U", str(path)], check=True)
        return path

    def _wait_until_it_accepts(self) -> None:
        deadline = time.monotonic() + START_S
        while True:
            assert self._process is not None
            if self._process.poll() is not None:
                pytest.fail(f"mosquitto ended with {self._process.returncode}:\n{self.log}")
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
            except OSError:
                if time.monotonic() > deadline:
                    pytest.fail(f"mosquitto does not listen after {START_S} s:\n{self.log}")
                time.sleep(0.005)  # a process tells nobody that it listens: it is asked again
            else:
                return
