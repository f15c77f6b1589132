"""What holds for every command: help, examples that run, clear errors, and data alone on a pipe.

Each table has a row for each command. Where something cannot go wrong, the row says why in words.
"""

import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import pytest
from reference.__main__ import FOLDER
from support.daemon import Daemon
from support.laptop import Ended, Laptop, again_and_again, panel_of
from support.line_master import LineMaster
from support.mqtt_probe import MqttProbe

from bridge.cli.main import COMMANDS, PROG
from bridge.simulator.faults import FaultKind
from bridge.simulator.module import SimulatedModule
from bridge.transport.opener import open_port


@dataclass(frozen=True)
class Fails:
    """A command line that fails, its exit status, and a part of the one line that says why."""

    line: str
    status: int
    told: str


NEEDS_NO_PORT = "it opens no port"
NEEDS_A_BACKUP = "it needs a backup first: test_backup"

MISSING_PORT: Mapping[str, Fails | str] = {
    "run": "an absent adapter is no exit: it is waited for, and logged (test_coming_and_going)",
    "check": NEEDS_NO_PORT,
    "simulate": Fails(
        "simulate --module DIO100@1 --pty /nowhere/port", 1, "line main cannot appear at /nowhere"
    ),
    "demo": "it makes its own ports",
    "watch": Fails("watch --timeout 1", 1, "no connection to the broker at 127.0.0.1:"),
    "send": Fails(
        "send garage do/3 ON --timeout 1",
        1,
        "Connection refused; check that it runs, and mqtt.host",
    ),
    "get": Fails("get --port /dev/ttyUSB7 --station 1", 1, "ttyUSB7: no such device: is the adap"),
    "set": Fails("set --port /dev/ttyUSB7 --station 1 do/1 ON", 1, "ttyUSB7: no such device"),
    "scan": Fails("scan /dev/ttyUSB7", 1, "ttyUSB7: no such device: is the adapter plugged in?"),
    "verify": Fails("verify /dev/ttyUSB7", 1, "ttyUSB7: no such device: is the adapter plugged"),
    "settings": Fails("settings show --port /dev/ttyUSB7 --station 1", 1, "no such device"),
    "eeprom": Fails("eeprom dump --port /dev/ttyUSB7 --station 1 x.hex", 1, "no such device"),
    "backup": Fails("backup x.zip", 1, "no such device"),
    "restore": NEEDS_A_BACKUP,
    "monitor": Fails("monitor /dev/ttyUSB7", 1, "ttyUSB7: no such device: is the adapter plugged"),
    "purge": Fails("purge", 1, "refused; check that it runs, and mqtt.host and mqtt.port"),
    "report": NEEDS_NO_PORT,
    "dip": NEEDS_NO_PORT,
    "schema": NEEDS_NO_PORT,
    "completion": NEEDS_NO_PORT,
}
HELD = "another program holds it"
BUSY_PORT: Mapping[str, Fails | str] = {
    "run": Fails("run", 1, f"{HELD}: stop that one first"),
    "check": NEEDS_NO_PORT,
    "simulate": "a pty is its own; test_simulate has the busy TCP port",
    "demo": "it takes a free port",
    "watch": "a broker serves many",
    "send": "a broker serves many",
    "get": Fails("get garage", 1, f"{HELD}: stop that one first; or, if that is the bridge, go th"),
    "set": Fails("set garage do/1 ON", 1, "go through it: wisco2mqtt -c config.yaml send garage"),
    "scan": Fails("scan /dev/ttyUSB0", 1, HELD),
    "verify": Fails(
        "verify garage", 1, f"{HELD}: stop that one first; or, if that is the bridge, g"
    ),
    "settings": Fails("settings show garage", 1, HELD),
    "eeprom": Fails("eeprom dump garage x.hex", 1, HELD),
    "backup": Fails("backup x.zip", 1, HELD),
    "restore": NEEDS_A_BACKUP,
    "monitor": Fails("monitor /dev/ttyUSB0", 1, HELD),
    "purge": "a broker serves many",
    "report": NEEDS_NO_PORT,
    "dip": NEEDS_NO_PORT,
    "schema": NEEDS_NO_PORT,
    "completion": NEEDS_NO_PORT,
}
ANSWERS_NOT = "does not answer wisco at 9600 baud"
NO_ANSWER: Mapping[str, Fails | str] = {
    "run": "a silent module is offline, and no failure of the bridge",
    "check": NEEDS_NO_PORT,
    "simulate": "it is who answers",
    "demo": "its modules answer",
    "watch": "whoever watches waits",
    "send": "test_send: no verdict says what to check",
    "get": Fails("get garage", 1, ANSWERS_NOT),
    "set": Fails("set garage do/1 ON", 1, ANSWERS_NOT),
    "scan": "test_scan: nobody there is a report of two lines",
    "verify": Fails("verify garage", 1, ANSWERS_NOT),
    "settings": Fails("settings show garage", 1, ANSWERS_NOT),
    "eeprom": Fails("eeprom dump garage x.hex", 1, ANSWERS_NOT),
    "backup": Fails("backup x.zip", 1, ANSWERS_NOT),
    "restore": NEEDS_A_BACKUP,
    "monitor": "test_monitor: a line where nothing passes is told",
    "purge": NEEDS_NO_PORT,
    "report": NEEDS_NO_PORT,
    "dip": NEEDS_NO_PORT,
    "schema": NEEDS_NO_PORT,
    "completion": NEEDS_NO_PORT,
}
WRONG_ARGUMENT: Mapping[str, Fails] = {
    "run": Fails("run now", 2, "unrecognized arguments: now"),
    "check": Fails("check --wrong", 2, "unrecognized arguments: --wrong"),
    "simulate": Fails("simulate --module DIO200@1", 2, "'DIO200@1' is no module: write DIO100 or"),
    "demo": Fails("demo 1883", 2, "unrecognized arguments: 1883"),
    "watch": Fails("watch garden", 2, "there is no station garden; there are: garage, pumps"),
    "send": Fails("send garage do/3 on!", 2, "ON! is no command to do/3: give one of ON, OFF,"),
    "get": Fails("get garage do/9", 2, "garage is a DIO100 and has no do/9"),
    "set": Fails("set garage do/9 ON", 2, "garage is a DIO100 and has no do/9"),
    "scan": Fails("scan /dev/ttyUSB0 --stations 40", 2, "'40' is no station or range: write 1-8,"),
    "verify": Fails("verify garden", 2, "there is no station garden; there are: garage, pumps"),
    "settings": Fails("settings diff garage", 2, "diff needs a FILE, such as one that show has"),
    "eeprom": Fails("eeprom dump garage x.txt", 2, "x.txt does not say its format: name it .hex"),
    "backup": Fails("backup", 2, "the following arguments are required: FILE"),
    "restore": Fails("restore", 2, "the following arguments are required: FILE"),
    "monitor": Fails("monitor /dev/ttyUSB0 --baud 1200", 2, "invalid choice: 1200"),
    "purge": Fails("purge garage", 2, "unrecognized arguments: garage"),
    "report": Fails("report x.txt --line cellar", 2, "there is no line cellar; there are: main"),
    "dip": Fails("dip 1011", 2, "4 switches given: a module has 8"),
    "schema": Fails("schema config.yaml", 2, "unrecognized arguments: config.yaml"),
    "completion": Fails("completion tcsh", 2, "invalid choice: 'tcsh'"),
}
TIME = r"\d\d:\d\d:\d\d\.\d{3}"
# What lines of stdout look like where it is a pipe, so that a script can read them.
DATA: Mapping[str, str] = {
    "run": r"(?!)",  # nothing: its log goes to stderr
    "check": (
        r"line main: cycle .* ms|  station .* bound .* ms.*|config.yaml is valid .*|\{.*\}"
        r"|  while stations are dead.*|  a scene on all stations .*|rule .*"
        r"|broker: .* takes us|line main: .* opens|station \w+: a DI?O100 answers"
    ),
    "simulate": r"line main: \S+ (wisco|modbus-rtu) 9600: .*",
    "demo": r".*",  # it is for people
    "watch": rf'{TIME} (= )?\S+ .*|\d\d:\d\d:\d\d \w+ +.*|\{{"time": .*\}}',
    "send": r'garage (do\S*|cover\S*) \S+: done in \d+ ms|\{.*"status": ?"done".*\}',
    "get": rf"ON|OFF|({TIME} (= )?)?(di|do)/\d+ (ON|OFF)|do/\d+/(mode|hold) \S+",
    "set": r"(garage|station 1) do\S* \S+: done in \d+ ms",
    "scan": r'\d+ +DI?O100 +9600 +wisco .*|\{"port": .*\}',
    "verify": r'[a-z0-9-]+ +.*|\{"version".*|(station \d|line \w+|[a-z_]+): .*',
    "settings": r"#.*|model: DIO100.*|outputs:|  \d+: \{mode: latch.*\}",
    "eeprom": r"(?!)",  # nothing: it goes to the file, and nothing differs
    "backup": r"(?!)",  # nothing: it goes to the file
    "restore": r"(?!)",  # nothing: nothing differs
    "monitor": r' *\d+\.\d{3} .* [<>] .*|\{"at": .*\}',
    "purge": r"(?!)",  # nothing: what it did goes to stderr
    "report": r"(?!)",  # nothing: it goes to the file
    "dip": r"[ +\-|#ONF0-9`'a-z]*|station 13 .*|\{.*\}",
    "schema": r".*",  # one JSON object over many lines: test_schema reads it
    "completion": r".*",  # a script: bash and zsh judge it in test_completion
}
# Who goes on until it is told to stop, and what it prints first.
ENDLESS: Mapping[str, str] = {
    "run": "(pumps): online: DO100",
    "simulate": "line main: ",
    "demo": "Ctrl-C ends the demo",
    "watch": "garage",
    "monitor": "01RDIH",
    "get --watch": "di/16 OFF",
}
EXAMPLES = {
    name: re.findall(rf"^{PROG} (.*)$", text.partition("```sh")[2], re.MULTILINE)
    for name in COMMANDS
    if (text := (FOLDER / f"{name}.md").read_text())
}


@pytest.fixture
def run(laptop: Laptop, call: Callable[[str], Ended]) -> Callable[[str], Ended]:
    """Runs a command line in this process, which is quick; the daemon gets one of its own."""
    return lambda line: laptop.run(line) if line == "run" else call(line)


def test_every_command_has_its_row() -> None:
    """A command that is added has to be thought through."""
    for table in (MISSING_PORT, BUSY_PORT, NO_ANSWER, WRONG_ARGUMENT, DATA):
        assert set(table) == set(COMMANDS)
    assert all(EXAMPLES.values())


@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_told(name: str, run: Callable[[str], Ended]) -> None:
    """On stdout, with the common options and every example, and nothing on stderr."""
    ended = run(f"{name} --help")
    assert (ended.status, ended.err) == (0, "")
    assert ended.out.startswith(f"usage: {PROG} {name} ")
    assert "--config" in ended.out
    assert "--log-level" in ended.out
    assert all(f"\n  {PROG} {line}\n" in ended.out for line in EXAMPLES[name])


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.usefixtures("mosquitto")
def test_the_examples_of_its_page_do_what_they_say(
    name: str, laptop: Laptop, call: Callable[[str], Ended]
) -> None:
    """One after the other, as they stand there; a pipe gets data alone.

    What a signal ends, and what needs a shell, gets a process.
    """
    with panel_of(laptop) as panel, _company(name, laptop, panel.module(1)):
        for line in (example.replace("10s", "1s") for example in EXAMPLES[name]):
            until = _until(line)
            ended = laptop.run(line, until=until) if until or ">" in line else call(line)
            while "the position is not known" in ended.out:  # the shutter is on its way still
                time.sleep(0.3)  # else the bridge takes no more of it
                ended = call(line)
            assert ended.status == 0, ended
            assert "\x1b" not in ended.out + ended.err
            assert "Traceback" not in ended.err
            odd = [one for one in ended.out.splitlines() if not re.fullmatch(DATA[name], one)]
            assert not odd


def _until(line: str) -> str | None:
    if "--watch" in line:
        return ENDLESS["get --watch"]
    if "--for" in line:
        return None
    if "--json" in line and line.startswith("monitor"):
        return '"station": 1'
    return ENDLESS.get(line.split(maxsplit=1)[0])


@contextmanager
def _company(name: str, laptop: Laptop, module: SimulatedModule) -> Iterator[None]:
    """Start what a command needs beside it: the bridge, a master on the line, a changing input."""
    with ExitStack() as stack:
        if name in {"watch", "send", "report"}:
            daemon = stack.enter_context(Daemon(laptop.config))
            daemon.wait_for_log("(garage): online: DIO100")
            with MqttProbe(laptop.broker_port, "+/bridge/state") as probe:
                probe.wait_for(lambda seen: any(m.payload == b"online" for m in seen))
        if name == "watch":
            stack.enter_context(again_and_again(lambda: module.toggle_input(1)))
        if name == "restore":
            assert laptop.run("backup cabinet.zip").status == 0
        if name == "monitor":
            master = stack.enter_context(LineMaster(str(laptop.port)))
            stack.enter_context(again_and_again(lambda: master.ask(b"#01RDIH\r", 8)))
        yield


@pytest.mark.parametrize("case", [c for c in MISSING_PORT.values() if isinstance(c, Fails)])
def test_a_missing_port_is_one_line(case: Fails, run: Callable[[str], Ended]) -> None:
    """A missing port, or a missing broker, gives one line."""
    _fails(case, run(case.line))


@pytest.mark.parametrize("case", [c for c in BUSY_PORT.values() if isinstance(c, Fails)])
def test_a_busy_port_is_one_line(case: Fails, laptop: Laptop, run: Callable[[str], Ended]) -> None:
    """Two masters would garble each other: it is left alone."""
    with panel_of(laptop) as line:
        port = open_port(line.port, 9600)
        try:
            _fails(case, run(case.line))
        finally:
            port.close()
        assert not line.log


@pytest.mark.parametrize("case", [c for c in NO_ANSWER.values() if isinstance(c, Fails)])
def test_no_reply_is_one_line(case: Fails, laptop: Laptop, run: Callable[[str], Ended]) -> None:
    """Without a reply one line names the station and the next step."""
    with panel_of(laptop) as line:
        line.faults.set(FaultKind.DEAF)
        _fails(case, run(case.line))


@pytest.mark.parametrize("case", WRONG_ARGUMENT.values())
def test_a_wrong_argument_is_one_line(
    case: Fails, laptop: Laptop, run: Callable[[str], Ended]
) -> None:
    """A wrong argument gives one line with the fault and the way to --help."""
    with panel_of(laptop):
        _fails(case, run(case.line))


def _fails(case: Fails, ended: Ended) -> None:
    assert (ended.status, ended.out) == (case.status, ""), ended
    assert ended.err.startswith(f"{PROG}"), ended
    assert ended.err.count("\n") == 1, ended
    assert case.told in ended.err
    if case.status == 2:
        assert ended.err.endswith(" --help)\n")
