"""`check`: the plan in words, a verdict, and what is tried with --live."""

import json
from collections.abc import Callable

from support.laptop import Ended, Laptop, panel_of
from support.mosquitto import Mosquitto

Call = Callable[[str], Ended]
CREDENTIAL = "username: wisco, password: !file /run/credentials/wisco2mqtt.service/mqtt-password"


def test_it_ends_with_a_verdict(call: Call) -> None:
    """The figures are explained, and the last line says whether all is well."""
    ended = call("check")
    assert (ended.status, ended.err) == (0, "")
    assert (
        "an input change is seen within 192 ms, an output change within 2.1 s, "
        "a command is done within 182 ms, a scene within 262 ms\n"
    ) in ended.out
    assert "\n  while stations are dead, however many: an input change is seen" in ended.out
    assert "\n  a scene on all stations of the line: 350 ms\n" in ended.out
    assert ended.out.endswith("config.yaml is valid (1 line, 2 stations): all is well\n")


def test_a_secret_that_cannot_be_read_is_a_remark(laptop: Laptop, call: Call) -> None:
    """The service may read more than who checks; a typing error still shows."""
    text = laptop.config.read_text()
    laptop.config.write_text(text.replace("mqtt: {", f"mqtt: {{{CREDENTIAL}, "))
    ended = call("check")
    assert ended.status == 0
    assert "config.yaml:1:" in ended.err
    assert "it is there only while the service runs" in ended.err
    assert ended.out.endswith("is valid (1 line, 2 stations), with 1 warning\n")


def test_json_is_one_object(call: Call) -> None:
    """The plan, in milliseconds."""
    document = json.loads(call("check --json").out)
    assert (document["valid"], document["ok"], document["problems"]) == (True, True, [])
    (line,) = document["lines"]
    assert [one["id"] for one in line["stations"]] == ["garage", "pumps"]
    assert line["stations"][1]["inputs_ms"] is None
    assert line["stations"][1]["seen_within"]["input_ms"] is None
    assert line["stations"][0]["seen_within"]["input_ms"] < line["while_dead"]["input_ms"]


def test_json_tells_problems_too(laptop: Laptop, call: Call) -> None:
    """Status 78 as ever; stderr is empty."""
    laptop.config.write_text("lines: []\n")
    ended = call("check --json")
    assert (ended.status, ended.err) == (78, "")
    (problem,) = json.loads(ended.out)["problems"]
    assert (problem["line"], problem["column"]) == (1, 8)


def test_live_tries_broker_ports_and_stations(
    laptop: Laptop, call: Call, mosquitto: Mosquitto
) -> None:
    """Each that answers is told, and status 0."""
    with panel_of(laptop):
        ended = call("check --live")
    assert (ended.status, ended.err) == (0, "")
    assert f"broker: 127.0.0.1:{mosquitto.port} takes us\n" in ended.out
    assert "station garage: a DIO100 answers\nstation pumps: a DO100 answers\n" in ended.out
    assert ended.out.endswith(": all is well\n")


def test_live_says_what_does_not_answer(call: Call) -> None:
    """Status 1, and each failure in words."""
    ended = call("check --live --json")
    assert ended.status == 1
    broker, line = json.loads(ended.out)["live"]
    assert (broker["ok"], line["ok"]) == (False, False)
    assert "Connection refused" in broker["told"]
    assert "no such device: is the adapter plugged in?" in line["told"]


def test_each_rule_is_said_in_words(laptop: Laptop, call: Call) -> None:
    """With the time within which it acts; JSON has the same."""
    rules = (
        "rules:\n"
        "  - {name: Scene, when: garage/di/3, is: OFF, only: broker_away,\n"
        "     then: {garage/do/4: TOGGLE, pumps/do/1: 'OFF'}, while: {garage/di/6: ON}}\n"
    )
    laptop.config.write_text(f"{laptop.config.read_text()}\n{rules}")
    said = (
        "when garage/di/3 goes OFF: garage/do/4 TOGGLE, pumps/do/1 OFF, while garage/di/6 is ON, "
        "only while the broker is away; answered within "
    )
    assert f"rule Scene: {said}" in call("check").out
    (rule,) = json.loads(call("check --json").out)["rules"]
    assert (rule["id"], rule["name"]) == ("scene", "Scene")
    assert rule["text"] == f"{said}{rule['answer_ms']:.0f} ms of that"
