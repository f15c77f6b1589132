"""`wisco2mqtt demo`: simulated modules, an embedded broker and the bridge, on one machine."""

import argparse
import logging
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import bridge
from bridge.cli.demo_broker import DemoBroker, free_port
from bridge.cli.desk.panel import objection_to_panel
from bridge.cli.frame.signals import StopSignals
from bridge.cli.watch import NOTE_VARIABLE
from bridge.config.endpoints import BROKER_PORTS
from bridge.config.load import load_config
from bridge.daemon.app import App, RunResult, Wanted
from bridge.daemon.systemd import Notifier
from bridge.errors import BridgeError
from bridge.simulator.build import build_line, endpoint_for
from bridge.simulator.player import Player
from bridge.simulator.scenario import load_scenario
from bridge.transport.lock import take_lock

NAME = "demo"
EXAMPLES = ("demo",)

_WATCH_AFTER_S = 2.5
_GOODBYE = re.compile(r" bridge +offline$")
_GOODBYE_S = 1.0
_WATCH_STOP_S = 2.0
_PANEL_PATIENCE_S = 10.0

_CONFIG = """\
# Written by `wisco2mqtt demo` for this run.
mqtt: {{host: 127.0.0.1, port: {broker}, protocol: "3.1.1"}}  # the embedded broker's
state_dir: {directory}
lines:
  - id: wisco
    port: {directory}/wisco
    protocol: wisco
    baud: 9600
    stations:
      - address: 1
        model: DIO100
        id: garage
        name: Garage
        inputs:
          1: {{name: Door, device_class: door}}
          2: {{name: Motion, device_class: motion}}
        outputs:
          1: {{name: Lamp, as: light}}
          2: {{name: Gate, mode: pulse, hold: 0.5s}}
      - {{address: 2, model: DO100, id: pumps, name: Pumps}}
  - id: rtu
    port: {directory}/rtu
    protocol: modbus-rtu
    baud: 9600
    stations:
      - {{address: 1, model: DIO100, id: cellar, name: Cellar}}
  - id: ascii
    port: {directory}/ascii
    protocol: modbus-ascii
    baud: 9600
    stations:
      - {{address: 1, model: DIO100, id: attic, name: Attic}}
"""

_SCENARIO = """\
loop: true
steps:
  - {at: 3s, line: wisco, station: 1, input: 1, set: TOGGLE}
  - {at: 5s, line: rtu, station: 1, input: 3, set: TOGGLE}
  - {at: 7s, line: wisco, station: 1, input: 2, set: ON}
  - {at: 8s, line: wisco, station: 1, input: 2, set: OFF}
  - {at: 10s, line: ascii, station: 1, input: 16, set: TOGGLE}
"""

_INTRO = """\
Three simulated RS485 lines, Wisco, Modbus RTU and Modbus ASCII, with a DIO100 each and a DO100 on
the first; a broker on 127.0.0.1:{broker}; and the bridge between them. Some inputs change by
themselves every few seconds. Try this in another terminal:

{lines}

Below is what the bridge logs, and every change that it publishes. Ctrl-C ends the demo.
"""
_NOTE = "In another terminal:\n{lines}"
_LINES = """\
  export PATH={path}:$PATH
  wisco2mqtt watch
  wisco2mqtt send garage do/1 ON
  wisco2mqtt send garage do/2 PRESS
  wisco2mqtt send pumps do 1=ON,4=ON,16=ON"""
# The command of the lines above: this very program, with the demo's configuration.
_SHIM = """\
#!/bin/sh
# Made by `wisco2mqtt demo`, and gone with it.
PYTHONPATH={source}${{PYTHONPATH:+:$PYTHONPATH}} exec {python} -m bridge -c {config} "$@"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Take no arguments but the common ones, and no configuration."""
    parser.description = (
        "Runs simulated modules, an embedded MQTT broker and the bridge on this machine, with "
        "nothing else installed, and prints what to look at; at a terminal it draws the modules, "
        "if the extra `cli` is there. Needs the extra `demo`."
    )


def run(args: argparse.Namespace) -> int:  # noqa: ARG001  # every command takes its arguments
    """Run until SIGINT or SIGTERM; return 1 when a part of it failed."""
    signals = StopSignals()
    signals.install()
    with ExitStack() as stack:
        directory = stack.enter_context(_folder())
        broker = DemoBroker(free_port(BROKER_PORTS["mqtt"]))
        broker.start()
        stack.callback(broker.stop)
        path = directory / "config.yaml"
        path.write_text(_CONFIG.format(broker=broker.port, directory=directory))
        config = load_config(path, os.environ)
        lines = {
            line.id: stack.enter_context(build_line(line, endpoint=endpoint_for(line, directory)))
            for line in config.lines
        }
        to_try = _LINES.format(path=_write_shim(directory, path))
        scenario = directory / "scenario.yaml"
        scenario.write_text(_SCENARIO)
        if objection_to_panel() is None:
            shown: _DemoPanel | _Watcher = _DemoPanel(path, _NOTE.format(lines=to_try))
        else:
            print(_INTRO.format(broker=broker.port, lines=to_try), flush=True)
            shown = _Watcher(path)
        stack.enter_context(shown)
        stack.enter_context(Player(load_scenario(scenario, lines)))
        outcome = App(config, Notifier(os.environ)).run(lambda: signals.poll() or shown.poll())
    return 0 if outcome is RunResult.STOPPED else 1


@contextmanager
def _folder() -> Iterator[Path]:
    """Make a folder with a name that is short to write, for the length of the block.

    It lies in the home, where no other user can put anything; a second demo gets another one.
    """
    with ExitStack() as stack:
        folder = Path.home() / ".wisco2mqtt-demo"
        try:
            stack.enter_context(take_lock(f"demo {folder}"))
            folder.mkdir(mode=0o700, exist_ok=True)
            stack.callback(shutil.rmtree, folder, ignore_errors=True)
        except (BridgeError, OSError):
            made = tempfile.TemporaryDirectory(prefix="wisco2mqtt-")
            folder = Path(stack.enter_context(made))
        yield folder


def _write_shim(directory: Path, config: Path) -> str:
    """Write what `wisco2mqtt` is for the demo, and return the folder to put on the PATH."""
    shim = directory / "bin" / "wisco2mqtt"
    shim.parent.mkdir(exist_ok=True)
    source = Path(bridge.__file__).parents[1]
    places = {"source": source, "python": sys.executable, "config": config}
    shim.write_text(_SHIM.format(**{name: shlex.quote(str(at)) for name, at in places.items()}))
    shim.chmod(0o755)
    try:
        return f"~/{shim.parent.relative_to(Path.home())}"
    except ValueError:
        return shlex.quote(str(shim.parent))


class _DemoPanel:
    """Has `watch --panel` take the terminal; the log, which would tear the picture, rests."""

    def __init__(self, config: Path, note: str) -> None:
        self._command = [sys.executable, "-m", "bridge", "watch", "--panel", "-c", str(config)]
        self._command += ["--timeout", f"{_PANEL_PATIENCE_S:g}"]
        self._environ = os.environ | {NOTE_VARIABLE: note}
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> None:
        logging.getLogger().setLevel(logging.ERROR)
        self._process = subprocess.Popen(self._command, env=self._environ)  # noqa: S603  # our own

    def __exit__(self, *_: object) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.wait(_WATCH_STOP_S)

    def poll(self) -> Wanted | None:
        """Tell that the person has closed it."""
        closed = self._process is not None and self._process.poll() is not None
        return Wanted.STOP if closed else None


class _Watcher:
    """Has a `watch` print beside us, once all modules are met."""

    def __init__(self, config: Path) -> None:
        self._command = [sys.executable, "-m", "bridge", "watch", "-c", str(config)]
        self._process: subprocess.Popen[str] | None = None
        self._goodbye = threading.Event()
        self._timer = threading.Timer(_WATCH_AFTER_S, self._watch)
        self._timer.daemon = True

    def __enter__(self) -> None:
        self._timer.start()

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()
        if self._process is not None:
            self._goodbye.wait(_GOODBYE_S)
            self._process.terminate()
            self._process.wait(_WATCH_STOP_S)

    def poll(self) -> Wanted | None:
        """It ends with the demo, and not before."""
        return None

    def _watch(self) -> None:
        # Ctrl-C does not reach it, so that it shows our end.
        self._process = subprocess.Popen(  # noqa: S603  # our own
            self._command, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        for line in self._process.stdout or ():
            print(line, end="", flush=True)
            if _GOODBYE.search(line):
                self._goodbye.set()
