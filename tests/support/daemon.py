"""The real daemon in a process of its own, as systemd would run it."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import pytest

from bridge.cli.frame.locks import SCOPE_VARIABLE

WAIT_S = 20.0  # generous: a wait ends as soon as its condition holds


class Daemon:
    """`python -m bridge run` with a log of its own. Use it with `with`.

    `program`: what Python runs in place of `-m bridge`; `environ` is added to the environment;
    `python` is another one than that of the tests.
    """

    def __init__(
        self,
        config: Path,
        *arguments: str,
        notify: socket.socket | None = None,
        program: Sequence[str] = ("-m", "bridge"),
        environ: Mapping[str, str] | None = None,
        python: str = sys.executable,
    ) -> None:
        self._config = config
        self._python = python
        self._arguments = arguments
        self._program = program
        self._environ = environ or {}
        self._notify = notify
        self._log = config.with_name("daemon.log")
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        environ = {name: value for name, value in os.environ.items() if name != "NOTIFY_SOCKET"}
        # Many run at a time, each at a broker of its own, and with one base topic.
        environ[SCOPE_VARIABLE] = str(self._config.parent)
        environ |= self._environ
        if self._notify is not None:
            environ["NOTIFY_SOCKET"] = self._notify.getsockname()
        command = [self._python, *self._program, "run", "-c", str(self._config)]
        with self._log.open("ab") as log:
            self._process = subprocess.Popen([*command, *self._arguments], env=environ, stderr=log)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            print(f"the daemon's log:\n{self.log}")  # pytest shows it beside the failure
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(WAIT_S)

    @property
    def process(self) -> "subprocess.Popen[bytes]":
        """The running process."""
        assert self._process is not None
        return self._process

    @property
    def log(self) -> str:
        """Return its output on stderr so far."""
        return self._log.read_text(errors="replace")

    def wait_for_log(self, text: str) -> None:
        """Waits until its log holds `text`."""
        deadline = time.monotonic() + WAIT_S
        while text not in self.log:
            if time.monotonic() > deadline or self.process.poll() is not None:
                pytest.fail(f"no {text!r} in the log:\n{self.log}")
            time.sleep(0.01)  # a file tells nobody that it grew: it is looked at again

    def signal(self, number: signal.Signals) -> None:
        """Sends it a signal."""
        self.process.send_signal(number)

    def stop(self) -> tuple[int, float]:
        """Sends SIGTERM; returns the exit status, and the seconds that it took."""
        began = time.monotonic()
        self.signal(signal.SIGTERM)
        status = self.process.wait(WAIT_S)
        return status, time.monotonic() - began
