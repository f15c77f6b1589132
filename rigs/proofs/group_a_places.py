"""A relay switched wrongly because of its place: A10 in the configuration, A13 on the line."""

import itertools
import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

from support.daemon import Daemon
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, broker

from bridge.config.load import load_config
from bridge.errors import ConfigError
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from proofs.figures import Figure, Run, proof

# --- A10 --------------------------------------------------------------------------------------

BAD_FILES = sorted((Path(__file__).parents[2] / "tests" / "config" / "bad").glob("*.yaml"))
HOME = {"HOME": "/home/wisco"}
EX_CONFIG = 78
PATIENCE_S = 20.0
_EXPECTED = re.compile("^# expect (.*)$", re.MULTILINE)


def _expected(path: Path) -> list[str]:
    """Return the expected problem in a file, as `LINE:COLUMN message`."""
    return _EXPECTED.findall(path.read_text(encoding="utf-8"))


def _is_refused(path: Path) -> bool:
    try:
        load_config(path, HOME)
    except ConfigError as error:
        return _expected(path) == [f"{it.line}:{it.column} {it.message}" for it in error.problems]
    return False


def _is_refused_by_the_command(path: Path) -> bool:
    """Return whether `run` exits at once, with the problems on stderr."""
    command = [sys.executable, "-m", "bridge", "run", "-c", str(path)]
    try:
        ended = subprocess.run(
            command,
            env=os.environ | HOME,
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
    except subprocess.TimeoutExpired:
        return False
    told = [
        line.removeprefix(f"{path}:").replace(": ", " ", 1) for line in ended.stderr.split("\n")
    ]
    return ended.returncode == EX_CONFIG and told == [*_expected(path), ""]


@proof("A10")
def bad_configurations_are_refused(run: Run) -> Figure:
    """Each problem is told with its place, and nothing is started."""
    refused = sum(map(_is_refused, BAD_FILES))
    tried = BAD_FILES[:: run.scale.of(30, 1)]
    ended = sum(map(_is_refused_by_the_command, tried))
    return Figure(
        injected=f"{len(BAD_FILES)} bad files",
        seen=f"{refused} refused with lines, {ended} of {len(tried)} runs ended with 78",
        promised="all refused, with line numbers",
        kept=refused == len(BAD_FILES) >= 30 and ended == len(tried),
    )


# --- A13 --------------------------------------------------------------------------------------

# Which outputs are commanded of a station: on the line of the other one nobody may touch them.
COMMANDED = {"west": range(1, 5), "east": range(5, 9)}


class _TwoLines:
    """Two adapters with a module each, and the links by which the configuration knows them."""

    def __init__(self, directory: Path) -> None:
        self.lines = {
            name: SimulatedLine(LineProtocol.MODBUS_RTU, 9600, [SimulatedModule(model, 1)])
            for name, model in (("west", DIO100), ("east", DO100))
        }
        self._directory = directory

    def point(self, *, right: bool) -> None:
        """Points the links at their own lines, or each at the other."""
        targets = [line.port for line in self.lines.values()]
        for name, target in zip(self.lines, targets if right else targets[::-1], strict=True):
            fresh = self._directory / "fresh"
            fresh.symlink_to(target)
            fresh.replace(self._directory / name)

    def replug(self, *, right: bool, linked_first: bool) -> None:
        """Pulls both adapters out and plugs them in again, the links pointed anew."""
        if linked_first:
            self.point(right=right)
        for line in self.lines.values():
            line.hang_up()
        self.point(right=right)
        for line in self.lines.values():
            line.restore()

    def config(self, broker_port: int) -> Path:
        """Writes the configuration, and gives its path."""
        lines = "".join(
            f"  - {{id: {name}, port: {self._directory / name}, baud: 9600, protocol: modbus-rtu,\n"
            f"     stations: [{{address: 1, model: {line.module(1).model.name}, id: {name}}}]}}\n"
            for name, line in self.lines.items()
        )
        path = self._directory / "config.yaml"
        path.write_text(
            f"mqtt: {{host: 127.0.0.1, port: {broker_port}}}\n"
            f"state_dir: {self._directory}\nlines:\n{lines}"
        )
        return path

    def orders(self, *, wrong: bool) -> int:
        """Orders to outputs that are commanded of the other station, or of this one."""
        return sum(
            times
            for name, line in self.lines.items()
            for (output, _), times in line.module(1).ordered.items()
            if (output not in COMMANDED[name]) is wrong
        )


def _command_until(over: threading.Event, port: int) -> None:
    with MqttProbe(port, f"{BASE}/nothing") as sender:
        for number in itertools.count():
            for name, outputs in COMMANDED.items():
                word = "ON" if number // len(outputs) % 2 else "OFF"
                sender.publish(f"{BASE}/{name}/do/{outputs[number % len(outputs)]}/set", word)
            if over.wait(0.05):
                return


def _wait_for_verdicts(probe: MqttProbe, said: dict[str, str]) -> None:
    """Wait until a new command to each station has this result."""
    probe.clear()
    wanted = {(f"{BASE}/{name}/result", *said.items()) for name in COMMANDED}

    def all_there(seen: list[Seen]) -> bool:
        came = {
            (message.topic, *said.items())
            for message in seen
            if said.items() <= json.loads(message.payload).items()
        }
        return wanted <= came

    probe.wait_for(all_there)


@proof("A13")
def links_point_elsewhere(run: Run) -> Figure:
    """Adapters that come back under each other's name: nothing is written to the wrong line."""
    swaps = run.scale.of(1, 25)
    two, over = _TwoLines(run.directory), threading.Event()
    with two.lines["west"], two.lines["east"], broker(run.directory) as mosquitto:
        two.point(right=True)
        with (
            MqttProbe(mosquitto.port, f"{BASE}/+/result") as probe,
            Daemon(two.config(mosquitto.port)),
        ):
            sender = threading.Thread(target=_command_until, args=(over, mosquitto.port))
            sender.start()
            try:
                _wait_for_verdicts(probe, {"status": "done"})
                for n in range(swaps):
                    two.replug(right=False, linked_first=n % 2 == 1)
                    _wait_for_verdicts(probe, {"reason": "wrong_model"})
                    two.replug(right=True, linked_first=n % 2 == 0)
                    _wait_for_verdicts(probe, {"status": "done"})
            finally:
                over.set()
                sender.join()
    wrong = two.orders(wrong=True)
    return Figure(
        injected=f"{2 * swaps} times two links re-pointed while commands come",
        seen=f"{wrong} writes to the wrong line, {two.orders(wrong=False)} to the right one",
        promised="0 writes to the wrong line",
        kept=wrong == 0,
    )
