"""Values that a key takes, value by value; what it refuses is shown by the files in `bad/`."""

from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from support.config_file import file_with, load_text, problems_of

from bridge.config.device_classes import BINARY_SENSOR_DEVICE_CLASSES
from bridge.config.schema import (
    CountConfig,
    GestureConfig,
    InputConfig,
    LineConfig,
    OnLossConfig,
    OutputConfig,
    Server,
    StationConfig,
    TlsConfig,
)
from bridge.model import BAUD_RATES, LineProtocol, Writes


def _line(folder: Path, keys: str) -> LineConfig:
    return load_text(folder, file_with(line=keys)).lines[0]


def _station(folder: Path, keys: str) -> StationConfig:
    return load_text(folder, file_with(station_keys=keys)).lines[0].stations[0]


@pytest.mark.parametrize(
    ("written", "field", "value"),
    [
        ("host: 10.0.0.5", "host", "10.0.0.5"),
        ("host: fe80::1%eth0", "host", "fe80::1%eth0"),
        ("port: 1", "port", 1),
        ("port: 65535", "port", 65535),
        ("protocol: auto", "protocol", "auto"),
        ("protocol: 5", "protocol", "5"),
        ("protocol: 3.1.1", "protocol", "3.1.1"),
        ("base_topic: home/wisco-2/x_1", "base_topic", "home/wisco-2/x_1"),
        ("client_id: Our bridge", "client_id", "Our bridge"),
        ("username: 007", "username", "007"),
        ("url: mqtt://broker", "port", 1883),
        ("url: mqtt://broker:1884/", "port", 1884),
        ("url: mqtts://broker.example", "port", 8883),
        ("url: mqtts://broker.example", "host", "broker.example"),
        ("url: 'mqtt://[::1]:1884'", "host", "::1"),
        ("url: mqtt://broker", "tls", None),
        ("url: mqtts://broker", "tls", TlsConfig()),
        ("servers: [10.0.0.2, '10.0.0.3:1884']", "host", "10.0.0.2"),
        ("servers: [10.0.0.2, '10.0.0.3:1884']", "others", (Server("10.0.0.3", 1884),)),
        ("command_qos: 0", "command_qos", 0),
        ("repeat: 5s", "repeat_s", 5.0),
        ("{servers: ['[fd00::2]'], tls: {}}", "servers", (Server("fd00::2", 8883),)),
        ("tls: {}", "tls", TlsConfig()),
        ("tls:", "tls", TlsConfig()),
        ("tls: {}", "port", 8883),
        ("{tls: {}, port: 1883}", "port", 1883),
    ],
)
def test_the_broker_takes(tmp_path: Path, written: str, field: str, value: Any) -> None:
    """The keys of `mqtt`, with what follows from them."""
    mqtt = load_text(tmp_path, file_with(top=f"mqtt:\n  {written}")).mqtt

    assert getattr(mqtt, field) == value


def test_the_client_id_tells_machine_and_base_topic(tmp_path: Path) -> None:
    """Two bridges on one broker must not throw each other out (docs/failures.md B4)."""
    first = load_text(tmp_path, file_with(top="mqtt: {base_topic: home/wisco}")).mqtt.client_id
    again = load_text(tmp_path, file_with(top="mqtt: {base_topic: home/wisco}")).mqtt.client_id

    assert first == again
    assert first.startswith("wisco2mqtt-")
    assert first.endswith("-home-wisco")


def test_tls_files_start_where_the_configuration_lies(tmp_path: Path) -> None:
    """Relative paths depend on the file, not on who starts the bridge from where."""
    for name in ("ca", "cert", "key"):
        (tmp_path / name).touch()
    top = f"mqtt:\n  url: mqtts://broker\n  tls: {{ca: ca, cert: {tmp_path}/cert, key: key}}"

    mqtt = load_text(tmp_path, file_with(top=top)).mqtt

    assert mqtt.tls == TlsConfig(*(tmp_path / name for name in ("ca", "cert", "key")))


@pytest.mark.parametrize(
    ("written", "field", "value"),
    [
        ("discovery: off", "discovery", "off"),
        ("discovery: single", "discovery", "single"),
        ("prefix: ha", "prefix", "ha"),
        ("prefix: ha", "status_topic", "ha/status"),
        ("status_topic: hass/status", "status_topic", "hass/status"),
        ("configuration_url: http://10.0.0.5:1880/", "configuration_url", "http://10.0.0.5:1880/"),
    ],
)
def test_homeassistant_takes(tmp_path: Path, written: str, field: str, value: str) -> None:
    """The keys of `homeassistant`; `off` is a word."""
    section = load_text(tmp_path, file_with(top=f"homeassistant: {{{written}}}")).homeassistant

    assert getattr(section, field) == value


@pytest.mark.parametrize(
    ("written", "field", "value"),
    [
        ("protocol: modbus-rtu", "protocol", LineProtocol.MODBUS_RTU),
        ("protocol: modbus-ascii", "protocol", LineProtocol.MODBUS_ASCII),
        ("protocol: modbus-rtu\nwrites: auto", "writes", Writes.AUTO),
        ("writes: wisco", "writes", Writes.WISCO),
        ("writes: modbus", "writes", Writes.MODBUS),
        ("turnaround: 2.5ms", "turnaround_s", 0.0025),
        ("turnaround: auto", "turnaround_auto", True),
        ("turnaround: auto", "turnaround_s", 0.005),
        ("turnaround: 5ms", "turnaround_auto", False),
        ("late_window: auto", "late_window_auto", True),
        ("late_window: auto", "late_window_s", 0.3),
        ("timeout: auto", "timeout_s", None),
        ("timeout: 0.5s", "timeout_s", 0.5),
        ("silence: auto", "silence_s", None),
        ("silence: 0", "silence_s", 0.0),
        ("silence: 0s", "silence_s", 0.0),
        ("silence: 0ms", "silence_s", 0.0),
        ("silence: 4ms", "silence_s", 0.004),
        ("late_window: 1s", "late_window_s", 1.0),
        ("late_window: 16.9s", "late_window_s", 16.9),
        ("timeout: 19.7s", "timeout_s", 19.7),
        ("output_sweep: 0s", "output_sweep_s", 0.0),
        ("output_sweep: 0.5s", "output_sweep_s", 0.5),
    ],
)
def test_a_line_takes(tmp_path: Path, written: str, field: str, value: Any) -> None:
    """The keys of a line; None stands for `auto`."""
    assert getattr(_line(tmp_path, written), field) == value


@pytest.mark.parametrize("baud", BAUD_RATES)
def test_a_line_takes_each_baud_rate_of_the_modules(tmp_path: Path, baud: int) -> None:
    """docs/protocol.md section 1 has four."""
    text = file_with().replace("9600", str(baud))

    assert load_text(tmp_path, text).lines[0].baud == baud


@pytest.mark.parametrize(
    "port", ["/dev/serial/by-id/usb-A B", "tcp://10.0.0.5:4196", "rfc2217://[::1]:2217"]
)
def test_a_line_takes_devices_and_gateways(tmp_path: Path, port: str) -> None:
    """The port stays as it is written: messages repeat it."""
    assert load_text(tmp_path, file_with().replace("/dev/ttyUSB0", port)).lines[0].port == port


@pytest.mark.parametrize(
    ("written", "field", "value"),
    [
        ("id: east-gate_2", "id", "east-gate_2"),
        ("id: '12'", "id", "12"),
        ("id: " + "x" * 48, "id", "x" * 48),
        ("id: garage", "name", "garage"),
        ("name: On", "name", "On"),
        ("name: 010", "name", "010"),
        ("name: null", "name", "null"),
        ("name: ห้องเครื่อง 🚪", "name", "ห้องเครื่อง 🚪"),
        ("name: " + "x" * 120, "name", "x" * 120),
        ("name: Porte d\u2019entr\u00e9e", "name", "Porte d\u2019entr\u00e9e"),
        ("name: Shed \u201cold\u201d", "name", "Shed \u201cold\u201d"),
        ("name: '\u201cOld\u201d shed'", "name", "\u201cOld\u201d shed"),
        ("name: Garage\u00a0S\u00fcd", "name", "Garage\u00a0S\u00fcd"),
        ("name: !!str 12", "name", "12"),
        ("area: Cellar", "area", "Cellar"),
        ("priority: high", "high_priority", True),
        ("priority: normal", "high_priority", False),
        ("rate_limit: 0.5", "rate_limit", 0.5),
        ("rate_limit: 1000", "rate_limit", 1000.0),
        ("interlock: [[1, 2], [3, 4, 8]]", "interlock", (0b11, 0b1000_1100)),
        ("interlock:\n  - [8, 1]", "interlock", (0b1000_0001,)),
        ("interlock: []", "interlock", ()),
        ("interlock: [[1, 2]]", "interlock_dead_s", 0.5),
        ("interlock_dead_time: 0", "interlock_dead_s", 0.0),
        ("interlock_dead_time: 1min", "interlock_dead_s", 60.0),
    ],
)
def test_a_station_takes(tmp_path: Path, written: str, field: str, value: Any) -> None:
    """The keys of a station; where text is due every word is text."""
    assert getattr(_station(tmp_path, written), field) == value


@pytest.mark.parametrize("address", [0, 31])
def test_a_wisco_station_takes_every_address(tmp_path: Path, address: int) -> None:
    """0 too, where no frame can be a Modbus broadcast."""
    text = file_with().replace("address: 1", f"address: {address}")

    assert load_text(tmp_path, text).lines[0].stations[0].address == address


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("{name: Door}", InputConfig(3, name="Door")),
        ("{invert: true}", InputConfig(3, invert=True)),
        ("{invert: false}", InputConfig(3)),
        ("{debounce: 60s}", InputConfig(3, debounce_s=60.0)),
        ("{debounce: '1min'}", InputConfig(3, debounce_s=60.0)),
        ("{gestures: true}", InputConfig(3, gestures=GestureConfig(0.8, 0.4))),
        ("{gestures: {}}", InputConfig(3, gestures=GestureConfig(0.8, 0.4))),
        ("{gestures: false}", InputConfig(3)),
        ("{gestures: {long: 200ms}}", InputConfig(3, gestures=GestureConfig(0.2, 0.4))),
        ("{gestures: {double: 0s}}", InputConfig(3, gestures=GestureConfig(0.8, 0.0))),
        (
            "{gestures: {long: 1min, double: 10s}}",
            InputConfig(3, gestures=GestureConfig(60.0, 10.0)),
        ),
        ("{count: true}", InputConfig(3, count=CountConfig())),
        ("{count: {}}", InputConfig(3, count=CountConfig())),
        ("{count: false}", InputConfig(3)),
        ("{count: {unit: bags}}", InputConfig(3, count=CountConfig("bags"))),
        ("{count: {factor: 1000000}}", InputConfig(3, count=CountConfig(factor=Decimal(10**6)))),
        (
            "{count: {unit: kWh, factor: 0.000000001, device_class: energy}}",
            InputConfig(3, count=CountConfig("kWh", Decimal("1E-9"), "energy")),
        ),
        ("{}", InputConfig(3)),
        ("", InputConfig(3)),
    ],
)
def test_an_input_takes(tmp_path: Path, written: str, expected: InputConfig) -> None:
    """The options of an input; without any it is there all the same."""
    inputs = _station(tmp_path, f"inputs:\n  3: {written}").inputs

    assert inputs[2] == expected
    assert len(inputs) == 16


@pytest.mark.parametrize("device_class", BINARY_SENSOR_DEVICE_CLASSES)
def test_an_input_takes_the_device_classes_of_home_assistant(
    tmp_path: Path, device_class: str
) -> None:
    """Each of the list, word for word."""
    config = _station(tmp_path, f"inputs: {{1: {{device_class: {device_class}}}}}")

    assert config.inputs[0].device_class == device_class


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("name: Lamp", OutputConfig(8, name="Lamp")),
        ("as: light", OutputConfig(8, kind="light")),
        ("as: valve", OutputConfig(8, kind="valve")),
        ("as: siren", OutputConfig(8, kind="siren")),
        ("as: fan", OutputConfig(8, kind="fan")),
        ("as: lock, mode: latch", OutputConfig(8, kind="lock", mode="latch")),
        ("as: switch, mode: pulse", OutputConfig(8, mode="pulse")),
        ("mode: pulse, hold: 0.1s", OutputConfig(8, mode="pulse", hold_s=0.1)),
        ("mode: pulse, hold: 300ms", OutputConfig(8, mode="pulse", hold_s=0.3)),
        ("mode: pulse, hold: 0.30000000000000004s", OutputConfig(8, mode="pulse", hold_s=0.3)),
        ("mode: pulse, hold: 25.5s", OutputConfig(8, mode="pulse", hold_s=25.5)),
        ("read_only: true", OutputConfig(8, read_only=True)),
        ("max_on: 10min", OutputConfig(8, max_on_s=600.0)),
        ("max_on: 1440min", OutputConfig(8, max_on_s=86400.0)),
        (
            "on_loss: {after: 30s, state: 'OFF'}",
            OutputConfig(8, on_loss=OnLossConfig(30.0, on=False)),
        ),
        ("on_loss: {after: 2s, state: ON}", OutputConfig(8, on_loss=OnLossConfig(2.0, on=True))),
    ],
)
def test_an_output_takes(tmp_path: Path, written: str, expected: OutputConfig) -> None:
    """The options of an output."""
    outputs = _station(tmp_path, f"outputs:\n  8: {{{written}}}").outputs

    assert outputs[7] == expected


def test_false_leaves_a_channel_out(tmp_path: Path) -> None:
    """A channel with `false` has no topic and no entity; the others keep their numbers."""
    config = _station(tmp_path, "inputs: {5: false}\noutputs: {1: false, 8: false}")

    assert [it.channel for it in config.inputs] == [n for n in range(1, 17) if n != 5]
    assert [it.channel for it in config.outputs] == [2, 3, 4, 5, 6, 7]


def test_one_address_may_stand_on_two_lines(tmp_path: Path) -> None:
    """Addresses are a matter of each line; ids are not."""
    text = file_with()
    other = text[text.index("  - id:") :].replace("main", "other").replace("USB0", "USB1")

    lines = load_text(tmp_path, f"{text}\n{other}").lines

    assert [line.stations[0].id for line in lines] == ["main_01", "other_01"]


def test_json_is_a_configuration_too(tmp_path: Path) -> None:
    """Quotes around keys, channels among them, are as good as none."""
    text = (
        '{"lines": [{"id": "main", "port": "/dev/ttyUSB0", "baud": 9600, "protocol": "wisco",'
        ' "stations": [{"address": 1, "model": "DIO100", "inputs": {"1": {"invert": true}}}]}]}'
    )

    assert load_text(tmp_path, text) == load_text(
        tmp_path, file_with(station_keys="inputs: {1: {invert: true}}")
    )


def test_an_alias_repeats_what_its_anchor_holds(tmp_path: Path) -> None:
    """Plain aliases are fine: two inputs with the same options."""
    inputs = _station(tmp_path, "inputs:\n  1: &door {device_class: door}\n  2: *door").inputs

    assert inputs[1] == replace(inputs[0], channel=2)


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("? [a]\n: b", "a key must be a plain word or number"),
        ("!env A: b", "a key must be a plain word or number"),
        ("x\x7fy: b", "the control character U+007F cannot stand in YAML; remove it"),
        ('"x\\ny": b', "unknown key 'x\\ny'; known are"),
        ("lines: !x []", "the word with ! before it is no tag known here"),
        ("mqtt: !env {}", "the word with ! before it is no tag known here"),
        ("%TAG ! tag:a,1:", "this cannot be read as YAML"),
    ],
)
def test_keys_are_plain_words(tmp_path: Path, key: str, told: str) -> None:
    """Keys and tags that YAML allows and a configuration does not."""
    assert any(told in problem for problem in problems_of(tmp_path, f"{key}\nstate_dir: /srv"))


@pytest.mark.parametrize(
    ("written", "told"),
    [
        ("9" * 5000, "write a whole number from 1 to 65535"),
        ("-1", "-1 is not a plain decimal number; write a whole number from 1 to 65535"),
        ("+5", "+5 is not a plain decimal number; write 5"),
        ("07", "07 is not a plain decimal number; write 7"),
        ("0b11", "0b11 is not a plain decimal number; write 3"),
        ("1.0", "1.0 is not a plain decimal number; write a whole number from 1 to 65535"),
        ("0", "0 is out of range; write a whole number from 1 to 65535"),
        ("|\n    1", "is not a plain decimal number; write 1"),
    ],
)
def test_a_number_that_others_might_read_is_refused_with_its_reading(
    tmp_path: Path, written: str, told: str
) -> None:
    """docs/failures.md A10: the message tells what to write where one can guess it."""
    (problem,) = problems_of(tmp_path, file_with(top=f"mqtt:\n  port: {written}"))

    assert told in problem
    assert len(problem) < 200


@pytest.mark.parametrize(
    ("top", "told"),
    [
        ('state_dir: "\\ud800"', "has the control character U+D800 at 1; remove it"),
        ("state_dir: " + "x" * 8193, "is longer than 8192 characters; shorten it"),
        ("homeassistant: {prefix: " + "x" * 201 + "}", "is too long"),
        ("mqtt: {base_topic: " + "/".join("x" * 48 for _ in range(5)) + "}", "ids joined by /"),
        ("mqtt: {username: ''}", "is empty; write one, or take the key out"),
        ("mqtt: {client_id: '  '}", "is empty or too long"),
        ("mqtt: {url: 'mqtt://broker:65536'}", "is not the address of a broker"),
        ("mqtt: {url: 'mqtt://'}", "is not the address of a broker"),
        ("mqtt: {servers: []}", "names no server; write one at least"),
        ("mqtt: {command_qos: 2}", "write a whole number from 0 to 1"),
        ("mqtt: {repeat: 0s}", "is out of range; write 1s to 60min"),
        ("mqtt: {servers: ['mqtt://a']}", "is not a server; write it like 10.0.0.2"),
        ("mqtt: {servers: ['a:65536']}", "is not a server; write it like 10.0.0.2"),
        ("mqtt: {servers: [a, 'a:1883']}", "each must be its own"),
        ("mqtt: {servers: [a], port: 1884}", "cannot stand beside servers"),
        ("mqtt:\n  tls:\n    key: config.yaml", "goes only together with cert; write both"),
    ],
)
def test_text_has_bounds(tmp_path: Path, top: str, told: str) -> None:
    """Texts that cannot go into a topic, a header or a log."""
    (problem,) = problems_of(tmp_path, file_with(top=top))

    assert told in problem


def test_an_id_of_which_nothing_can_stay_gets_the_rule(tmp_path: Path) -> None:
    """If no id can be proposed, the message gives the rule for ids."""
    (problem,) = problems_of(tmp_path, file_with(station_keys="id: ประตู"))

    assert "ประตู cannot be an id; write a-z and 0-9 joined by" in problem


def test_a_problem_behind_an_alias_shows_where_the_text_stands(tmp_path: Path) -> None:
    """The place is the anchor's, the key path is that of the use."""
    keys = "inputs:\n  1: &door {device_class: dor}\n  2: *door"
    first, second = problems_of(tmp_path, file_with(station_keys=keys))

    assert first.split()[0] == second.split()[0]
    assert "inputs.1.device_class" in first
    assert "inputs.2.device_class" in second


def test_a_mend_of_one_problem_does_not_need_the_others(tmp_path: Path) -> None:
    """A wrong protocol says nothing about station 0 and writes: those may be right."""
    text = file_with(line="protocol: nonsense\nwrites: wisco").replace("address: 1", "address: 0")
    (problem,) = problems_of(tmp_path, text)

    assert "lines[0].protocol" in problem


def test_a_station_of_a_line_without_id_is_read_all_the_same(tmp_path: Path) -> None:
    """Without the id of its line, a station is still read and its problems are reported."""
    text = file_with(station_keys="name: ''").replace("id: main", "id: Main")
    told = problems_of(tmp_path, text)

    assert [problem.split()[1] for problem in told] == [
        "lines[0].id:",
        "lines[0].stations[0].name:",
    ]
