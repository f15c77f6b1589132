"""A panel, a laptop, and a shell: command lines are run as they stand in the documents."""

import os
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import pytest
from support.mosquitto import free_port

from bridge.cli.frame.locks import SCOPE_VARIABLE
from bridge.cli.main import main
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from bridge.simulator.pty import PtyEndpoint

PATIENCE_S = 40.0  # generous: the machine may be busy
BIN = Path(sys.executable).parent


@dataclass(frozen=True)
class Ended:
    """The exit status of a command line, and what it printed to two pipes."""

    status: int
    out: str
    err: str

    @property
    def complaint(self) -> str:
        """The one line on stderr of a command that failed."""
        assert self.out == ""
        assert self.err.count("\n") == 1, self.err
        return self.err


def ended_of(capsys: pytest.CaptureFixture[str], *words: str) -> Ended:
    """Run a command line that ends soon in this process."""
    try:
        status = main(words)
    except SystemExit as end:
        status = int(end.code or 0)
    told = capsys.readouterr()
    return Ended(status, told.out, told.err)


class Laptop:
    """`directory` stands for /tmp and the home, its ttyUSB0 is the panel and its ttyUSB1 listens.

    Its config.yaml has a DIO100 `garage` at station 1, with a shutter, and a DO100 `pumps` at 2.
    """

    def __init__(self, directory: Path, broker_port: int) -> None:
        self.directory = directory
        self.broker_port = broker_port
        self.port = directory / "ttyUSB0"
        self.config = directory / "config.yaml"
        self.config.write_text(
            f"mqtt: {{host: 127.0.0.1, port: {broker_port}}}\n"
            f"state_dir: {directory}\n"
            "lines:\n"
            f"  - {{id: main, port: {self.port}, baud: 9600, protocol: wisco, stations: [\n"
            "     {address: 1, model: DIO100, id: garage, covers: {shutter:\n"
            "      {open: 6, close: 7, open_time: 1s, close_time: 1s}}},\n"
            "     {address: 2, model: DO100, id: pumps}]}\n"
        )
        for folder in (
            "lines",
            ".zfunc",
            ".config/fish/completions",
            ".local/share/bash-completion/completions",
        ):
            (directory / folder).mkdir(parents=True)

    def start(self, line: str) -> "subprocess.Popen[str]":
        """Start a command line without the program's name; its stdin has no terminal."""
        for there, here in self._places():
            line = line.replace(there, here)
        environ = os.environ | {
            "PATH": f"{BIN}:{os.environ['PATH']}",
            "HOME": str(self.directory),
            SCOPE_VARIABLE: str(self.directory),
        }
        pipe = subprocess.PIPE
        return subprocess.Popen(
            ["sh", "-c", f"exec wisco2mqtt {line}"],
            stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, text=True,
            cwd=self.directory, env=environ,
        )  # fmt: skip

    def call(
        self, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> Ended:
        """Run a command line that ends soon in this process."""
        for there, here in self._places():
            line = line.replace(there, here)
        monkeypatch.chdir(self.directory)
        monkeypatch.setenv("HOME", str(self.directory))
        monkeypatch.setenv(SCOPE_VARIABLE, str(self.directory))
        with Path(os.devnull).open() as nobody:
            monkeypatch.setattr(sys, "stdin", nobody)
            return ended_of(capsys, *shlex.split(line))

    def run(self, line: str, *, until: str | None = None) -> Ended:
        """Runs a command line to its end; `until`: ends it once it has printed that."""
        with self.start(line) as process, _Printed(process) as printed:
            if until is not None:
                printed.wait_for(until)
                process.send_signal(signal.SIGTERM)
            try:
                status = process.wait(PATIENCE_S)
            finally:
                process.kill()
        return Ended(status, printed.of("out"), printed.of("err"))

    def _places(self) -> Iterator[tuple[str, str]]:
        yield "/tmp/", f"{self.directory}/"  # noqa: S108  # as the documents write it
        yield "/dev/ttyUSB", f"{self.directory}/ttyUSB"
        yield "--host localhost", f"--host 127.0.0.1 --port {self.broker_port}"
        yield "--tcp 4196", f"--tcp {free_port()}"


class _Printed:
    """Collects what a process prints to its two pipes while it runs."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        streams = {"out": process.stdout, "err": process.stderr}
        self._process = process
        self._texts: dict[str, list[str]] = {name: [] for name in streams}
        self._more = threading.Condition()
        self._threads = [
            threading.Thread(target=self._collect, args=(name, stream))
            for name, stream in streams.items()
        ]

    def _collect(self, name: str, stream: Iterator[str]) -> None:
        for line in stream:
            with self._more:
                self._texts[name].append(line)
                self._more.notify_all()

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is not None:
            self._process.kill()
        for thread in self._threads:
            thread.join()

    def of(self, name: str) -> str:
        """All of a stream so far."""
        return "".join(self._texts[name])

    def wait_for(self, text: str) -> None:
        """Waits until one of the streams has it."""
        with self._more:
            came = self._more.wait_for(
                lambda: text in self.of("out") or text in self.of("err"), PATIENCE_S
            )
        assert came, f"no {text!r} in\n{self._texts}"


@contextmanager
def panel_of(laptop: Laptop, *, paced: bool = False) -> Iterator[SimulatedLine]:
    """The two modules of its configuration, at its ttyUSB0."""
    modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2)]
    endpoint = PtyEndpoint(laptop.port, baud=9600)
    tap = PtyEndpoint(laptop.directory / "ttyUSB1", baud=9600)
    line = SimulatedLine(LineProtocol.WISCO, 9600, modules, endpoint=endpoint, tap=tap, paced=paced)
    with line:
        yield line


@contextmanager
def again_and_again(action: Callable[[], object]) -> Iterator[None]:
    """Call `action` twenty times a second, in its own thread."""
    done = threading.Event()

    def work() -> None:
        while not done.wait(0.05):
            action()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
