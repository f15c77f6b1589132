"""`wisco2mqtt simulate`, as a process of its own."""

import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Self

import pytest
from support.line_master import LineMaster
from support.mosquitto import free_port

PATIENCE_S = 20.0
COMMAND = (sys.executable, "-m", "bridge", "simulate")
CONFIG = """\
mqtt: {{host: localhost}}
state_dir: {directory}
lines:
  - id: main
    port: /dev/ttyUSB0
    protocol: wisco
    baud: 19200
    stations:
      - {{address: 1, model: DIO100}}
      - {{address: 2, model: DO100}}
  - id: attic
    port: tcp://127.0.0.1:{port}
    protocol: modbus-rtu
    baud: 57600
    stations:
      - {{address: 1, model: DIO100, outputs: {{1: {{mode: pulse, hold: 0.1s}}}}}}
"""


class Simulation:
    """The running command: its lines of stdout as they come, its stdin."""

    def __init__(self, *arguments: str, stdin: int = subprocess.PIPE) -> None:
        self.process = subprocess.Popen(
            (*COMMAND, *arguments),
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._lines: dict[str, queue.Queue[str]] = {"out": queue.Queue(), "err": queue.Queue()}
        self._readers = [
            threading.Thread(target=self._read, args=(name, stream))
            for name, stream in (("out", self.process.stdout), ("err", self.process.stderr))
        ]
        for reader in self._readers:
            reader.start()

    def _read(self, name: str, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                self._lines[name].put(line.rstrip("\n"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        for reader in self._readers:
            reader.join()
        if self.process.stdin:
            self.process.stdin.close()

    def out(self) -> str:
        """The next line of stdout."""
        return self._lines["out"].get(timeout=PATIENCE_S)

    def err(self) -> str:
        """The next line of stderr."""
        return self._lines["err"].get(timeout=PATIENCE_S)

    def type(self, line: str) -> None:
        """Types a line."""
        assert self.process.stdin
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Sends a signal and returns the exit status."""
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)


Simulate = Callable[..., Simulation]


@pytest.fixture
def simulate() -> Iterator[Simulate]:
    """Starts the command; ends it after the test."""
    started: list[Simulation] = []

    def start(*arguments: str, stdin: int = subprocess.PIPE) -> Simulation:
        started.append(Simulation(*arguments, stdin=stdin))
        return started[-1]

    yield start
    for simulation in started:
        with simulation:
            pass


def port_of(ready: str) -> str:
    """The port in `line main: PORT wisco 9600: 1 DIO100`."""
    return ready.split()[2]


def test_modules_of_flags(simulate: Simulate) -> None:
    """One line tells where the modules are; they answer there; their outputs are printed."""
    simulation = simulate("--module", "DIO100@1", "--module", "DO100@2", "--module", "DO100@31")
    ready = simulation.out()
    port = port_of(ready)
    assert ready == f"line main: {port} wisco 9600: 1 DIO100, 2 DO100"
    with LineMaster(port) as master:
        assert master.ask(b"#1FWDO15,11\r", 6) == b"DO>OK\r"
        assert simulation.out() == "31 do/1 ON"
        assert simulation.out() == "31 do/5 ON"
    assert simulation.end() == 0
    assert not os.path.lexists(port)


def test_inputs_driven_by_hand(simulate: Simulate) -> None:
    """Typed lines drive inputs, take modules away and show them; slips are told in a line."""
    simulation = simulate("--module", "DIO100@1", "--module", "DO100@2", "--unpaced")
    port = port_of(simulation.out())
    for order in ("1 di/3 ON", "", "1 di/16 TOGGLE", "2 away", "show"):
        simulation.type(order)
    assert simulation.out() == "1 DIO100: inputs ON 3, 16; outputs ON none"
    assert simulation.out() == "2 DO100 (away): outputs ON none"
    with LineMaster(port) as master:
        assert master.ask(b"#01RDIH\r", 8) == b"DI>8004\r"
    simulation.type("1 di/17 ON")
    assert simulation.err() == "station 1, a DIO100, has no input 17: it has 16"
    assert simulation.end(signal.SIGINT) == 0


def test_pulse_end_is_printed(simulate: Simulate, tmp_path: Path) -> None:
    """A configuration is simulated line by line; a pulse is seen to begin and to end."""
    port = free_port()
    config = tmp_path / "config.yaml"
    config.write_text(CONFIG.format(directory=tmp_path, port=port))
    simulation = simulate("-c", str(config), "--directory", str(tmp_path))
    link = tmp_path / "main"
    assert simulation.out() == f"line main: {link} wisco 19200: 1 DIO100, 1 DO100"
    assert simulation.out() == f"line attic: tcp://127.0.0.1:{port} modbus-rtu 57600: 1 DIO100"
    with LineMaster(f"tcp://127.0.0.1:{port}") as master:
        coil_1_on = bytes.fromhex("01050000FF008C3A")
        assert master.ask(coil_1_on, 8) == coil_1_on
    assert simulation.out() == "attic/1 do/1 ON"
    assert simulation.out() == "attic/1 do/1 OFF"
    with LineMaster(str(link)) as master:
        simulation.type("main/1 di/2 ON")
        simulation.type("show")
        assert simulation.out() == "main/1 DIO100: inputs ON 2; outputs ON none"
        assert master.ask(b"#01RDIH\r", 8) == b"DI>0002\r"
    assert simulation.end() == 0
    assert not os.path.lexists(link)


def test_modbus_rtu_over_tcp(simulate: Simulate) -> None:
    """`--tcp`, `--protocol` and `--baud` are what the line has."""
    port = free_port()
    flags = ("--tcp", str(port), "--protocol", "modbus-rtu", "--baud", "57600")
    simulation = simulate("--module", "DIO100@1", *flags, "--turnaround", "0")
    assert simulation.out() == f"line main: tcp://127.0.0.1:{port} modbus-rtu 57600: 1 DIO100"
    with LineMaster(f"tcp://127.0.0.1:{port}") as master:
        reply = master.ask(bytes.fromhex("0101000000083DCC"), 6)
    assert reply == bytes.fromhex("010101005188")


def test_link_at_a_path(simulate: Simulate, tmp_path: Path) -> None:
    """`--pty PATH` makes a link there, and takes it away at the end."""
    path = tmp_path / "port"
    simulation = simulate("--module", "DIO100@0", "--pty", str(path))
    assert simulation.out() == f"line main: {path} wisco 9600: 1 DIO100"
    with LineMaster(str(path)) as master:
        assert master.ask(b"#00RDIH\r", 8) == b"DI>0000\r"
    assert simulation.end() == 0
    assert list(tmp_path.iterdir()) == []


def test_fault_flag(simulate: Simulate) -> None:
    """`--fault deaf=1`: never an answer, and nothing is carried out."""
    simulation = simulate("--module", "DIO100@1", "--fault", "deaf=1", "--fault", "echo=1")
    with LineMaster(port_of(simulation.out())) as master:
        assert master.ask(b"#01WDO1,1\r", 99, patience_s=0.2) == b"#01WDO1,1\r"
    simulation.type("show")
    assert simulation.out() == "1 DIO100: inputs ON none; outputs ON none"


def test_scenario(simulate: Simulate, tmp_path: Path) -> None:
    """`--scenario` moves inputs by itself."""
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("steps: [{every: 20ms, station: 1, input: 1, set: TOGGLE}]")
    simulation = simulate("--module", "DIO100@1", "--unpaced", "--scenario", str(scenario))
    with LineMaster(port_of(simulation.out())) as master:
        for wanted in (b"DI>0001\r", b"DI>0000\r"):
            while master.ask(b"#01RDIH\r", 8) != wanted:
                pass
    assert simulation.end() == 0


def test_end_of_stdin_is_not_the_end(simulate: Simulate) -> None:
    """After the end of stdin, as in the background, the modules continue."""
    simulation = simulate("--module", "DIO100@1", stdin=subprocess.DEVNULL)
    with LineMaster(port_of(simulation.out())) as master:
        for _ in range(3):
            assert master.ask(b"#01RDIH\r", 8) == b"DI>0000\r"
    assert simulation.end() == 0


def test_port_in_use(simulate: Simulate) -> None:
    """A TCP port that another has is told."""
    port = str(free_port())
    first = simulate("--module", "DIO100@1", "--tcp", port)
    assert port in first.out()
    second = simulate("--module", "DIO100@1", "--tcp", port)
    assert second.process.wait(PATIENCE_S) == 1
    assert f"line main cannot appear at tcp://127.0.0.1:{port}" in second.err()
