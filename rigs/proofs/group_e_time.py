"""Operation: E3 what a day with a fault writes, E4 a clock that jumps."""

import ast
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from support.daemon import Daemon
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, broker, is_complete, panel, results, write_config

import bridge
from bridge.model import LineProtocol
from proofs import dead_days, jumping_daemon
from proofs.figures import Figure, Run, proof

# --- E3 ---------------------------------------------------------------------------------------

LINES_AN_HOUR = 20


def _days(hours: int) -> tuple[int, int]:
    """Returns the most log lines in an hour, and how many files were opened for writing."""
    script = str(Path(dead_days.__file__).resolve())
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, sys.path))}
    ended = subprocess.run(
        [sys.executable, script, str(hours)], env=environ, capture_output=True, check=True
    )
    report = json.loads(ended.stdout)
    assert len(report["lines"]) == len(dead_days.FAULTS)
    return max(report["lines"].values()), report["writes"]


def _written_by_a_daemon(run: Run) -> int:
    """Return how many files the daemon wrote, or held open to write, while a module is dead."""
    state = run.directory / "state"
    state.mkdir()
    with panel(LineProtocol.MODBUS_RTU) as line, broker(run.directory) as mosquitto:
        line.module(2).away = True
        config = write_config(run.directory, line, mosquitto.port)
        config.write_text(config.read_text().replace("state_dir: ", f"state_dir: {state} # "))
        with Daemon(config) as daemon:
            daemon.wait_for_log("online: DIO100")
            daemon.wait_for_log("offline: station 2")
            daemon.wait_for_log("connected to the broker")
            before = _files(state)
            time.sleep(run.scale.of(2, 30))  # in which something could be written
            assert daemon.process.poll() is None
            held = set(_open_for_writing(daemon.process.pid))
            return len(held) + len(before ^ _files(state))


def _files(directory: Path) -> set[tuple[str, int]]:
    return {(str(path), path.stat().st_mtime_ns) for path in directory.rglob("*")}


def _open_for_writing(pid: int) -> Iterator[Path]:
    for link in Path(f"/proc/{pid}/fd").iterdir():
        flags = Path(f"/proc/{pid}/fdinfo/{link.name}").read_text().split()[3]
        standard = link.name in {"0", "1", "2"}  # whoever started it gave it those
        if not standard and link.is_file() and int(flags, 8) & (os.O_WRONLY | os.O_RDWR):
            yield link.readlink()


@proof("E3")
def something_is_wrong_for_a_day(run: Run) -> Figure:
    """A dead module, or a missing port, is told once; nothing is written to disk."""
    hours = run.scale.of(1, 24)
    lines, writes = _days(hours)
    writes += _written_by_a_daemon(run)
    return Figure(
        injected=f"{len(dead_days.FAULTS)} steady faults for {hours} h each (virtual clock)",
        seen=f"{lines} log lines in the worst hour, {writes} file writes",
        promised=f"at most {LINES_AN_HOUR} lines an hour, 0 writes",
        kept=lines <= LINES_AN_HOUR and writes == 0,
    )


# --- E4 ---------------------------------------------------------------------------------------

# Where the time of day is what is wanted: for logs, and for people.
EDGES = ("daemon/wiring.py", "cli/")
WALL_CLOCK = {
    "time": {"time", "time_ns", "localtime", "gmtime", "ctime", "strftime"},
    "datetime": {"now", "utcnow", "today", "fromtimestamp"},
    "date": {"today", "fromtimestamp"},
}


def _readers_of_the_wall_clock() -> Iterator[str]:
    root = Path(bridge.__file__).parent
    for path in root.rglob("*.py"):
        if any(_is_wall_clock(node) for node in ast.walk(ast.parse(path.read_text()))):
            yield path.relative_to(root).as_posix()


def _is_wall_clock(node: ast.AST) -> bool:
    match node:
        case ast.Attribute(value=ast.Name(id=owner), attr=name):
            return name in WALL_CLOCK.get(owner, ())
        case ast.ImportFrom(module="time", names=names):
            return any(alias.name in WALL_CLOCK["time"] for alias in names)
    return False


def _wait_for_verdicts(probe: MqttProbe, count: int) -> None:
    probe.wait_for(lambda seen: len(results(seen)) >= count)


def _offline(seen: list[Seen]) -> int:
    return sum(message.payload == b"offline" for message in seen)


@proof("E4")
def the_clock_jumps_by_a_day(run: Run) -> Figure:
    """Nothing that waits or counts looks at the time of day."""
    seconds = run.scale.of(3, 60)
    strangers = [name for name in _readers_of_the_wall_clock() if not name.startswith(EDGES)]
    program = (str(Path(jumping_daemon.__file__).resolve()),)
    with panel(LineProtocol.MODBUS_RTU) as line, broker(run.directory) as mosquitto:
        config = write_config(run.directory, line, mosquitto.port)
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config, program=program) as it:
            probe.wait_for(is_complete)
            probe.clear()
            until, asked = time.monotonic() + seconds, 0
            while time.monotonic() < until:
                asked += 1
                line.module(1).toggle_input(1)
                probe.wait_message(f"{BASE}/garage/di/1", "ON" if asked % 2 else "OFF")
                probe.publish(f"{BASE}/pumps/do/3/set", "TOGGLE")
                _wait_for_verdicts(probe, asked)
                it.signal(signal.SIGHUP)  # it logs that nothing changed, and the time of day
            done = sum(verdict["status"] == "done" for verdict in results(probe.seen))
            lapses = _offline(probe.seen)
            days = {entry[:10] for entry in it.log.splitlines()}
            complaints = sum(" INFO " not in entry for entry in it.log.splitlines())
    return Figure(
        injected=f"clock set by 2 days, {2 * seconds} times, {asked} commands",
        seen=f"{lapses + complaints} time-outs, {done} done; {len(strangers)} other readers",
        promised="0 time-outs, all done, read at the edges only",
        # Unless the log has more days than one, nothing was proved.
        kept=not (lapses or complaints or strangers) and done == asked and len(days) > 1,
    )
