"""`wisco2mqtt demo`: simulated modules, an embedded broker and the bridge, on one machine."""

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path

from bridge.cli.demo_broker import DemoBroker, free_port
from bridge.cli.frame.signals import StopSignals
from bridge.config.load import load_config
from bridge.daemon.app import App, RunResult
from bridge.daemon.systemd import Notifier
from bridge.simulator.build import build_line, endpoint_for
from bridge.simulator.player import Player
from bridge.simulator.scenario import load_scenario

NAME = "demo"
HELP = "show everything at work: simulated modules, a broker, the bridge"
EXAMPLES = ("demo",)

_USUAL_MQTT_PORT = 1883
_WATCH_AFTER_S = 2.5
_GOODBYE = "bridge/state offline\n"
_GOODBYE_S = 1.0
_WATCH_STOP_S = 2.0

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

  {command} watch -c {config}
  {command} send -c {config} garage do/1 ON
  {command} send -c {config} garage do/2 PRESS
  {command} send -c {config} pumps do 1=ON,4=ON,16=ON

Below is what the bridge logs, and every change that it publishes. Ctrl-C ends the demo.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Take no arguments but the common ones, and no configuration."""
    parser.description = (
        "Runs simulated modules, an embedded MQTT broker and the bridge on this machine, with "
        "nothing else installed, and prints what to look at. Needs the extra `demo`."
    )


def run(args: argparse.Namespace) -> int:  # noqa: ARG001  # every command takes its arguments
    """Run until SIGINT or SIGTERM; return 1 when a part of it failed."""
    signals = StopSignals()
    signals.install()
    with ExitStack() as stack:
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="wisco2mqtt-")))
        broker = DemoBroker(free_port(_USUAL_MQTT_PORT))
        broker.start()
        stack.callback(broker.stop)
        path = directory / "config.yaml"
        path.write_text(_CONFIG.format(broker=broker.port, directory=directory))
        config = load_config(path, os.environ)
        lines = {
            line.id: stack.enter_context(build_line(line, endpoint=endpoint_for(line, directory)))
            for line in config.lines
        }
        print(_INTRO.format(broker=broker.port, command=_command(), config=path), flush=True)
        stack.enter_context(_Watcher(path))
        scenario = directory / "scenario.yaml"
        scenario.write_text(_SCENARIO)
        stack.enter_context(Player(load_scenario(scenario, lines)))
        outcome = App(config, Notifier(os.environ)).run(signals.poll)
    return 0 if outcome is RunResult.STOPPED else 1


class _Watcher:
    """Starts `watch` beside the demo, once its first output of 200 lines is over."""

    def __init__(self, config: Path) -> None:
        self._command = [sys.executable, "-m", "bridge", "watch", "--changes", "-c", str(config)]
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

    def _watch(self) -> None:
        # Ctrl-C does not reach it, so that it shows our end.
        self._process = subprocess.Popen(  # noqa: S603  # our own
            self._command, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        for line in self._process.stdout or ():
            print(line, end="", flush=True)
            if line.endswith(_GOODBYE):
                self._goodbye.set()


def _command() -> str:
    """Return the command with which another terminal starts this program."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m bridge"
    return shlex.quote(str(called.absolute()))
