"""Mistakes that people make: each is one line that says what, where and what to do."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.laptop import Ended, Laptop
from support.mqtt_probe import MqttProbe

BAD = Path(__file__).parents[1] / "config/bad"
BAD_FILES = sorted(BAD.glob("*.yaml"))
# `check` only warns of these.
SECRETS_ARE_ELSEWHERE = {BAD / "environment_unset.yaml", BAD / "file_missing.yaml"}
STATION = "{address: 1, model: DIO100, id: garage}"


def line_of(**changes: str) -> str:
    """A configuration with one line, some keys of it changed; an empty text takes one out."""
    keys = {
        "id": "main",
        "port": "/dev/ttyUSB0",
        "baud": "9600",
        "protocol": "wisco",
        "stations": f"[{STATION}]",
    } | changes
    return f"lines: [{{{', '.join(f'{key}: {value}' for key, value in keys.items() if value)}}}]"


def station(text: str) -> str:
    """A configuration with one station that has these keys besides."""
    return line_of(stations=f"[{{address: 1, model: DIO100, id: garage, {text}}}]")


@dataclass(frozen=True)
class Mistake:
    """A command line, the configuration that it finds, and how it ends."""

    line: str
    status: int
    told: str
    config: str | None = None

    def __str__(self) -> str:
        return f"{self.line}: {self.told}"


def wrong(config: str, told: str) -> Mistake:
    """A configuration that `check` refuses."""
    return Mistake("check", 78, told, config)


CONFIGURATIONS = [
    wrong("", "the file is empty; config.example.yaml shows every key"),
    wrong(line_of(id=""), "id is missing; write a short name for topics, such as main"),
    wrong(line_of(port=""), "port is missing; write a device such as /dev/ttyUSB0, or tcp://"),
    wrong(line_of(port="COM3"), "COM3 is not a port; write an absolute path such as /dev/ttyUSB0"),
    wrong(line_of(baud="'9600'"), "'9600' is not a plain decimal number; write 9600"),
    wrong(line_of(protocol="rtu"), "rtu is not known here; write one of wisco, modbus-rtu, modb"),
    wrong(line_of(timeout="200"), "200 is not a duration; write a number and its unit (ms, s"),
    wrong(line_of(buad="9600"), "unknown key buad; did you mean baud?"),
    wrong(line_of(stations="[{address: 1, model: DIO200}]"), "DIO200 is not known here; write one"),
    wrong(line_of(stations="[{address: 1}]"), "model is missing; write DIO100 or DO100"),
    wrong(station("id: Garage"), "key id stands on line 1 already; remove one"),
    wrong(line_of(id="My Line"), "My Line cannot be an id; write my-line (a-z and 0-9 joined"),
    wrong(station("inputs: {17: {name: Door}}"), "no channel 17 here; a DIO100 has inputs 1 to 16"),
    wrong(station("inputs: {1: {device_class: dor}}"), "(did you mean door?)"),
]
ARGUMENTS = [
    Mistake("", 2, "the following arguments are required: COMMAND"),
    Mistake("chekc", 2, "invalid choice: 'chekc'"),
    Mistake("help chekc", 2, "invalid choice: 'chekc'"),
    Mistake("check -c nowhere.yaml", 78, "there is no such file; write it, or name another with -"),
    Mistake("check -c .", 78, "cannot be read (it is a directory, not a file); check what it is"),
    Mistake("send garage do/1", 2, "the following arguments are required: VALUE"),
    Mistake("send garden do/1 ON", 2, "there is no station garden; there are: garage, pumps"),
    Mistake("send garage 1 ON", 2, "1 is no target: give do/3, do for several outputs"),
    Mistake("send garage do/1 ONN", 2, "ONN is no command to do/1: give one of ON, OFF, TOGGLE, P"),
    Mistake(
        "send garage do/1/hold 30", 2, "30 is no hold time: give 0.1 to 25.5 seconds, in steps"
    ),
    Mistake("send garage do/1 ON --deadline 90", 2, "a deadline is 0.1 to 60 s, not 90"),
    Mistake("watch --port 1884", 2, "--port goes with --host"),
    Mistake(
        "watch --host x --password-file config.yaml", 2, "--password-file goes with --username"
    ),
    Mistake("watch --host x --base-topic Home", 2, "Home cannot be a base topic: write it like"),
    Mistake("watch --panel", 2, "--panel needs a terminal, and this is none"),
    Mistake("get", 2, "name a station of the configuration, or give --port and --station"),
    Mistake("get --port /dev/ttyUSB0", 2, "--port goes with --station: say which module"),
    Mistake("get --station 1", 2, "--station goes with --port; or name a station of the configura"),
    Mistake("scan", 2, "give a PORT, or --line with a line of the configuration"),
    Mistake("scan --line cellar", 2, "there is no line cellar; there are: main"),
    Mistake("scan /dev/ttyUSB0 --stations 0-40", 2, "'0-40' is no station or range: write 1-8,12"),
    Mistake("scan /dev/none --line main", 2, "give a PORT, or --line"),
    Mistake("scan --line main --baud 9600", 2, "--baud goes with a PORT"),
    Mistake("monitor", 2, "give a PORT, or --line"),
    Mistake("monitor --line cellar", 2, "there is no line cellar; there are: main"),
    Mistake("monitor --line main --baud 9600", 2, "--baud goes with a PORT"),
    Mistake(
        "eeprom dump --broker --port /dev/none --station 1 x.bin",
        2,
        "--broker goes with a station of the configuration",
    ),
    Mistake("dip --station 40", 2, "station 40 is not one of 0-31"),
]
BROKER_AND_PORTS = [
    Mistake("watch --host 127.0.0.1 --port 9", 1, "no connection to the broker at 127.0.0.1:9: "),
    Mistake("watch --host nowhere.invalid", 1, "no connection to the broker at nowhere.invalid:18"),
    Mistake("scan /tmp/config.yaml", 1, "config.yaml: "),
    Mistake("get --port tcp://127.0.0.1:9 --station 1", 1, "is the gateway on, and its address"),
    Mistake("get --port tcp:127.0.0.1:9 --station 1", 1, "no such device"),
]


def test_there_are_as_many_as_were_promised() -> None:
    """Sixty at the least, the files of tests/config/bad among them, and none twice."""
    mistakes = [*CONFIGURATIONS, *ARGUMENTS, *BROKER_AND_PORTS]
    assert len({(one.line, one.config) for one in mistakes}) == len(mistakes)
    assert len(mistakes) + len(BAD_FILES) >= 60


@pytest.mark.parametrize("mistake", [*CONFIGURATIONS, *ARGUMENTS, *BROKER_AND_PORTS], ids=str)
def test_a_mistake_is_one_line(
    mistake: Mistake, laptop: Laptop, call: Callable[[str], Ended]
) -> None:
    """What is wrong, where, and what to do; 2 wrong usage, 78 the configuration, 1 the rest."""
    if mistake.config is not None:
        laptop.config.write_text(mistake.config)
    ended = call(mistake.line)
    assert (ended.status, ended.out) == (mistake.status, ""), ended
    assert mistake.told in ended.err
    assert ended.err.count("\n") == 1, ended.err
    assert "Traceback" not in ended.err


def test_a_bad_file_is_one_line_for_each_problem(call: Callable[[str], Ended]) -> None:
    """`check` refuses each file of tests/config/bad with 78, and tells what is expected alone."""
    for path in set(BAD_FILES) - SECRETS_ARE_ELSEWHERE:
        ended = call(f"check -c {path}")
        assert (ended.status, ended.out) == (78, ""), path
        expected = path.read_text(encoding="utf-8").count("# expect ")
        assert ended.err.count(f"{path}:") == ended.err.count("\n") == expected, path


@pytest.mark.usefixtures("mosquitto")
def test_a_bridge_that_is_not_there_is_said(laptop: Laptop, call: Callable[[str], Ended]) -> None:
    """At once, where it said goodbye."""
    with MqttProbe(laptop.broker_port) as probe:
        probe.publish("wisco/bridge/state", "offline", retain=True)
    for line in ("scan --line main", "monitor --line main"):
        ended = call(line)
        assert ended.status == 1
        assert "the bridge is not running: wisco/bridge/state says offline\n" in ended.err
