"""Mistakes that people make: each is one line that says what, where and what to do."""

from collections.abc import Callable
from pathlib import Path

import pytest
from support.laptop import Ended, Laptop, ended_of
from support.mqtt_probe import MqttProbe

from bridge.cli.main import PROG

Call = Callable[[str], Ended]
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


# What `check` finds in a configuration.
CONFIGURATIONS = {
    "": "the file is empty; config.example.yaml shows every key",
    line_of(id=""): "id is missing; write a short name for topics, such as main",
    line_of(port=""): "port is missing; write a device such as /dev/ttyUSB0, or tcp://",
    line_of(port="COM3"): "COM3 is not a port; write an absolute path such as /dev/ttyUSB0",
    line_of(baud="'9600'"): "'9600' is not a plain decimal number; write 9600",
    line_of(protocol="rtu"): "rtu is not known here; write one of wisco, modbus-rtu, modb",
    line_of(timeout="200"): "200 is not a duration; write a number and its unit (ms, s",
    line_of(buad="9600"): "unknown key buad; did you mean baud?",
    line_of(stations="[{address: 1, model: DIO200}]"): "DIO200 is not known here; write one",
    line_of(stations="[{address: 1}]"): "model is missing; write DIO100 or DO100",
    station("id: Garage"): "key id stands on line 1 already; remove one",
    line_of(id="My Line"): "My Line cannot be an id; write my-line (a-z and 0-9 joined",
    station("inputs: {17: {name: Door}}"): "no channel 17 here; a DIO100 has inputs 1 to 16",
    station("inputs: {1: {device_class: dor}}"): "(did you mean door?)",
}
# What ends with 2.
WRONG_USAGE = {
    "": "the following arguments are required: COMMAND",
    "chekc": "invalid choice: 'chekc'",
    "help chekc": "invalid choice: 'chekc'",
    "--log-level loud dip": "invalid choice: 'loud'",
    "dip -c": "expected one argument",
    "send garage do/1": "the following arguments are required: VALUE",
    "send garden do/1 ON": "there is no station garden; there are: garage, pumps",
    "send garage 1 ON": "1 is no target: give do/3, do for several outputs",
    "send garage di/3 ON": "di/3 is no target",
    "send garage do/0 ON": "do/0 is no target",
    "send garage do/1 ONN": "ONN is no command to do/1: give one of ON, OFF, TOGGLE, P",
    "send garage do/3 OPEN": "OPEN is no command to do/3",
    "send garage do ON": "ON is no command to do",
    "send garage do 1=ON,1=OFF": "give each output once",
    "send garage do/1/hold 30": "30 is no hold time: give 0.1 to 25.5 seconds, in steps",
    "send garage do/1 ON --deadline 61": "a deadline is 0.1 to 60 s, not 61",
    "watch --port 1884": "--port goes with --host",
    "watch --host x --password-file config.yaml": "--password-file goes with --username",
    "watch --host x --base-topic Home": "Home cannot be a base topic: write it like",
    "watch --panel": "--panel needs a terminal, and this is none",
    "get": "name a station of the configuration, or give --port and --station",
    "get --port /dev/ttyUSB0": "--port goes with --station: say which module",
    "get --station 1": "--station goes with --port; or name a station of the configura",
    "get --port /dev/none --station 32": "station 32 is not one of 0-31",
    "get --port /dev/none --station 0 --protocol modbus-rtu": "0 is no station but all of them",
    "get --port /dev/none --station 1 do/0": "do/0 is no target",
    "get --port /dev/none --station 1 do di": "di is one word too many",
    "set --port /dev/none --station 1 do/3": "give a TARGET and a VALUE",
    "set --port /dev/none --station 1 do/3 ON OFF": "give a TARGET and a VALUE",
    "set --port /dev/none --station 1 di/3 ON": "di/3 is no target",
    "set --port /dev/none --station 1 do/3 OPEN": "OPEN is no command to do/3",
    "set --port /dev/none --station 1 cover/shutter OPEN": (
        "only the bridge moves covers: use `wisco2mqtt send`"
    ),
    "set --port /dev/none --station 1 do 1=ON,1=OFF": "give each output once",
    "set --port /dev/none --station 1 do/3/mode toggle": "toggle is no mode: give latch or pulse",
    "set --port /dev/none --station 1 do/3/hold 0.05": "0.05 is no hold time",
    "set --port /dev/none --station 1 do/3/hold 25.6": "25.6 is no hold time",
    "set --port /dev/none --station 1 do/3/hold 0.55": "in steps of 0.1 s",
    "set --port /dev/none --station 1 do/3/hold 0": "0 is no hold time",
    "set --port /dev/none --station 1 do/3/hold long": "long is no hold time",
    "scan": "give a PORT, or --line with a line of the configuration",
    "scan --line cellar": "there is no line cellar; there are: main",
    "scan /dev/none --line main": "give a PORT, or --line",
    "scan --line main --baud 9600": "--baud goes with a PORT",
    "scan /dev/none --stations 0-40": "'0-40' is no station or range: write 1-8,12",
    "scan /dev/none --stations 32": "'32' is no station or range",
    "scan /dev/none --stations 8-1": "'8-1' is no station or range",
    "scan /dev/none --baud 1200": "'1200' is none of 9600, 19200, 57600, 4800",
    "scan /dev/none --protocol rtu": "'rtu' is none of wisco",
    "scan /dev/none --expect 0": "'0' is no count",
    "scan /dev/none --margin 200": "'200' is no time",
    "scan /dev/none --quick --thorough": "not allowed with argument",
    "scan /dev/none --stations 0 --protocol modbus-rtu": "0 is no station but all of them",
    "monitor": "give a PORT, or --line",
    "monitor --line cellar": "there is no line cellar; there are: main",
    "monitor --line main --baud 9600": "--baud goes with a PORT",
    "monitor p --for soon": "'soon' is no time",
    "settings show garage garage.yaml": "garage.yaml is one word too many for show",
    "settings apply garage": "apply needs a FILE",
    "settings burn garage": "invalid choice: 'burn'",
    "eeprom dump --broker --port /dev/none --station 1 x.bin": (
        "--broker goes with a station of the configuration"
    ),
    "eeprom dump --port /dev/none --station 13": "dump needs a FILE",
    "eeprom dump a.hex b.hex --port /dev/none --station 13": "b.hex is one word too many for dump",
    "eeprom erase a.hex --port /dev/none --station 13": "invalid choice: 'erase'",
    "eeprom dump a.hex --protocol modbus-rtu --port /dev/none --station 13": "set DIP switch 8 ON",
    "dip": "give eight switch positions, or --station",
    "dip --baud 9600": "give eight switch positions, or --station",
    "dip --station 32": "station 32 is not one of 0-31",
    "dip 1011010": "7 switches given: a module has 8",
    "dip 1011012x": "switches are 0 or 1, and '2' is neither",
    "dip 10110101 --baud 9600": "either switch positions or --station",
    "dip --station 1 --baud 1200": "invalid choice: 1200 (choose from",
    "simulate": "say what to simulate: --module DIO100@1, -c FILE, or --replay FILE",
    "simulate --replay a --module DIO100@1": "--replay does not go with --module",
    "simulate -c x --baud 9600": "--baud does not go with -c: the file says what",
    "simulate --module DIO100@32": "'DIO100@32' is no module",
    "simulate --module DIO100@1 --module DO100@1": "two modules have one station",
    "simulate --module DIO100@1 --baud 1200": "invalid choice: 1200",
    "simulate --module DIO100@1 --turnaround 2": "'2' is no time: write a number and it",
    "simulate --module DIO100@1 --tcp 65536": "'65536' is no port: write 1 to 65535",
    "simulate --module DIO100@1 --fault silent": "'silent' is no fault: write a kind, =",
    "simulate --module DIO100@1 --fault silent=2": "'silent=2' is no fault",
    "simulate --module DIO100@1 --directory x": "--directory goes with -c",
}
# What ends otherwise.
FAILURES = [
    (78, "check -c nowhere.yaml", "there is no such file; write it, or name another with -"),
    (78, "check -c .", "cannot be read (it is a directory, not a file); check what it is"),
    (78, "simulate -c /nowhere/config.yaml", "/nowhere/config.yaml:1:1:"),
    (78, "simulate --module DIO100@1 --scenario /nowhere", "/nowhere:1:1: the scenario can"),
    (1, "simulate --replay gone.txt", "gone.txt cannot be read: No such file"),
    (1, "watch --host 127.0.0.1 --port 9", "no connection to the broker at 127.0.0.1:9: "),
    (1, "watch --host nowhere.invalid", "no connection to the broker at nowhere.invalid:18"),
    (1, "scan /tmp/config.yaml", "config.yaml: "),
    (1, "get --port tcp://127.0.0.1:9 --station 1", "is the gateway on, and its address"),
    (1, "get --port tcp:127.0.0.1:9 --station 1", "no such device"),
]


def test_there_are_as_many_as_were_promised() -> None:
    """Sixty at the least."""
    assert len(CONFIGURATIONS) + len(WRONG_USAGE) + len(FAILURES) >= 60


@pytest.mark.parametrize(("config", "told"), CONFIGURATIONS.items(), ids=CONFIGURATIONS.values())
def test_a_mistake_in_the_configuration_is_one_line(
    config: str, told: str, laptop: Laptop, call: Call
) -> None:
    """`check` says what is wrong, where, and what to do."""
    laptop.config.write_text(config)
    _is_one_line(call("check"), 78, told)


@pytest.mark.parametrize(
    ("status", "line", "told"),
    [*((2, *one) for one in WRONG_USAGE.items()), *FAILURES],
)
def test_a_mistake_is_one_line(status: int, line: str, told: str, call: Call) -> None:
    """2 is wrong usage, 78 the configuration, 1 the rest."""
    ended = call(line)
    _is_one_line(ended, status, told)
    assert status != 2 or ended.err.endswith(" --help)\n")


def _is_one_line(ended: Ended, status: int, told: str) -> None:
    assert ended.status == status, ended
    assert told in ended.complaint
    assert ended.err.startswith(PROG) is (status != 78)


def test_a_bad_file_is_one_line_for_each_problem(capsys: pytest.CaptureFixture[str]) -> None:
    """`check` refuses each file of tests/config/bad with 78, and tells what is expected alone."""
    for path in set(BAD_FILES) - SECRETS_ARE_ELSEWHERE:
        ended = ended_of(capsys, "check", "-c", str(path))
        assert (ended.status, ended.out) == (78, ""), path
        expected = path.read_text(encoding="utf-8").count("# expect ")
        assert ended.err.count(f"{path}:") == ended.err.count("\n") == expected, path


@pytest.mark.usefixtures("mosquitto")
def test_a_bridge_that_is_not_there_is_said(laptop: Laptop, call: Call) -> None:
    """At once, where it said goodbye."""
    with MqttProbe(laptop.broker_port) as probe:
        probe.publish("wisco/bridge/state", "offline", retain=True)
    for line in ("scan --line main", "monitor --line main"):
        ended = call(line)
        assert ended.status == 1
        assert "the bridge is not running: wisco/bridge/state says offline\n" in ended.err
