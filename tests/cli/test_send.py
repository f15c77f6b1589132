"""`send`: against a real broker, with a scripted bridge behind it."""

import argparse
import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe

from bridge.cli import send
from bridge.cli.frame.usage import UsageError
from bridge.cli.main import main
from bridge.cli.send import understand
from bridge.cli.views.verdict_words import outcome

DONE = {"target": "do/3", "payload": "ON", "status": "done", "ms": 41}


@pytest.fixture(autouse=True)
def _leave_logging_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.cli.main.configure_logging", lambda *_: None)


@pytest.fixture
def config(tmp_path: Path, mosquitto: Mosquitto) -> Path:
    """A configuration with one station, at the broker."""
    return write_config(tmp_path, mosquitto.port)


def write_config(directory: Path, port: int) -> Path:
    """Writes a configuration with the station `garage`."""
    path = directory / "config.yaml"
    path.write_text(
        f"mqtt: {{host: 127.0.0.1, port: {port}}}\n"
        f"state_dir: {directory}\n"
        "lines:\n"
        "  - {id: main, port: /dev/serial/by-id/usb-x, baud: 9600, protocol: wisco,\n"
        "     stations: [{address: 1, model: DIO100, id: garage}]}\n"
    )
    return path


@contextmanager
def bridge_that_answers(port: int, **verdict: Any) -> Iterator[list[tuple[str, Any]]]:
    """Answers the first command with a verdict, as the bridge would; yields the commands."""
    commands: list[tuple[str, Any]] = []
    filters = ("wisco/+/set", "wisco/+/do/+/set")
    with MqttProbe(port, *filters) as probe:

        def answer() -> None:
            command = probe.wait_for(bool)[0]
            asked = json.loads(command.payload)
            commands.append((command.topic, asked))
            assert not command.retain
            probe.publish("wisco/garage/result", "{no verdict")
            probe.publish("wisco/garage/result", json.dumps({**verdict, "id": "another"}))
            probe.publish("wisco/garage/result", json.dumps({**verdict, "id": asked["id"]}))

        thread = threading.Thread(target=answer)
        thread.start()
        yield commands
        thread.join()


def test_a_command_is_sent_and_its_verdict_printed(
    mosquitto: Mosquitto, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One output: the topic names it, the id is drawn, and the verdict takes one line."""
    with bridge_that_answers(mosquitto.port, **DONE) as commands:
        assert main(["-c", str(config), "send", "garage", "do/3", "on"]) == 0
    topic, asked = commands[0]
    assert topic == "wisco/garage/do/3/set"
    assert asked.pop("id")
    assert asked == {"state": "ON"}
    assert capsys.readouterr().out == "garage do/3 ON: done in 41 ms\n"


def test_several_outputs_go_in_one_message(
    mosquitto: Mosquitto, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`do` takes a list; id and deadline of the command line are the message's."""
    verdict = {"target": "do", "status": "refused", "reason": "offline", "ms": 0}
    options = ["--id", "x1", "--deadline", "0.5"]
    with bridge_that_answers(mosquitto.port, **verdict) as commands:
        arguments = ["-c", str(config), "send", "garage", "do", "1=ON,4=OFF", *options]
        assert main(arguments) == 1
    expected = {"do": {"1": "ON", "4": "OFF"}, "id": "x1", "deadline": 0.5}
    assert commands == [("wisco/garage/set", expected)]
    assert capsys.readouterr().out == "garage do 1=ON,4=OFF: refused: offline\n"


def test_json_prints_the_verdict_as_it_came(
    mosquitto: Mosquitto, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Programs get the object."""
    with bridge_that_answers(mosquitto.port, **DONE):
        arguments = ["send", "garage", "do/3", "ON", "--id", "7", "--json", "-c", str(config)]
        assert main(arguments) == 0
    assert json.loads(capsys.readouterr().out) == {**DONE, "id": "7"}


@pytest.mark.parametrize(
    ("state", "words"), [(None, "was never published"), ("offline", "says offline")]
)
def test_no_verdict_says_what_to_check(
    mosquitto: Mosquitto,
    config: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    state: str | None,
    words: str,
) -> None:
    """A bridge that does not run is the likeliest cause, and the broker knows of it."""
    monkeypatch.setattr(send, "_SPARE_S", 0.3)
    with MqttProbe(mosquitto.port) as probe:
        if state is not None:
            probe.publish("wisco/bridge/state", state, retain=True)
    arguments = ["-c", str(config), "send", "garage", "do/3", "ON", "--deadline", "0.2"]
    assert main(arguments) == 1
    expected = f"no verdict in 0.5 s: is the bridge running? wisco/bridge/state {words}"
    assert capsys.readouterr().err == f"wisco2mqtt: {expected}\n"


def test_a_port_that_says_nothing_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Something listens there, and it is no broker."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        config = write_config(tmp_path, port)
        arguments = ["-c", str(config), "send", "garage", "do/3", "ON", "--timeout", "0.3"]
        assert main(arguments) == 1
    expected = (
        f"no answer of the broker at 127.0.0.1:{port} in 0.3 s; check mqtt.host and mqtt.port"
    )
    assert capsys.readouterr().err == f"wisco2mqtt: {expected}\n"


@pytest.mark.timeout(30)  # far less than the command is allowed to try
def test_a_refused_password_is_one_line_at_once(
    make_mosquitto: Callable[..., Mosquitto], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A refused password ends the command at once, with one line."""
    broker = make_mosquitto(users={"owner": "o"})
    config = write_config(tmp_path, broker.port)
    arguments = ["-c", str(config), "send", "garage", "do/3", "ON", "--timeout", "1000"]
    assert main(arguments) == 1
    error = capsys.readouterr().err
    assert "refuses clients without a username" in error
    assert error.endswith("check mqtt.username and mqtt.password\n")
    assert error.count("\n") == 1


@pytest.mark.parametrize("word", ["ON", "OFF", "TOGGLE", "PRESS"])
def test_every_word_of_an_output_is_taken(word: str) -> None:
    """In small letters too."""
    assert understand("do/16", word.lower()).request == {"state": word}


@pytest.mark.parametrize(
    ("target", "value", "request_"),
    [
        ("do/3/mode", "pulse", {"mode": "pulse"}),
        ("do/3/mode", "latch", {"mode": "latch"}),
        ("do/16/hold", "0.5", {"hold": 0.5}),
        ("do/16/hold", "25", {"hold": 25.0}),
    ],
)
def test_settings_are_sent_to_topics_of_their_own(
    target: str, value: str, request_: dict[str, object]
) -> None:
    """The topic names the setting, and so does the key."""
    asked = understand(target, value)
    assert (asked.topic, asked.request) == (f"{target}/set", request_)
    assert asked.words == f"{target} {value}"


@pytest.mark.parametrize(
    ("target", "value"),
    [("do/3/mode", "ON"), ("do/3/hold", "0.55"), ("do/3/hold", "1s"), ("do/3/name", "x")],
)
def test_what_is_no_setting_is_not_sent(target: str, value: str) -> None:
    """Two modes, seconds with one decimal at the most, and no other setting."""
    with pytest.raises(UsageError):
        understand(target, value)


@pytest.mark.parametrize(
    ("value", "topic", "wish"),
    [
        ("open", "cover/shutter/set", {"state": "OPEN"}),
        ("STOP", "cover/shutter/set", {"state": "STOP"}),
        ("40", "cover/shutter/position/set", {"position": 40}),
    ],
)
def test_a_cover_takes_words_and_positions(value: str, topic: str, wish: dict[str, Any]) -> None:
    """Each goes to the topic that the bridge reads it from."""
    asked = understand("cover/shutter", value)
    assert (asked.topic, asked.request) == (topic, wish)


@pytest.mark.parametrize("value", ["ON", "40.5", "-1", "1000", ""])
def test_what_is_no_command_to_a_cover_is_not_sent(value: str) -> None:
    """The words are named."""
    with pytest.raises(UsageError, match="OPEN, CLOSE, STOP"):
        understand("cover/shutter", value)


def test_an_output_of_three_digits_is_no_target() -> None:
    """No model has one."""
    with pytest.raises(UsageError):
        understand("do/100", "ON")


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ({"status": "done", "ms": 7, "seen_on": True}, "done in 7 ms"),
        (
            {"status": "done", "ms": 7, "seen_on": False},
            "done in 7 ms, but the read after it did not see it ON",
        ),
        (
            {"status": "failed", "reason": "module_refused", "code": 3, "detail": "it said no"},
            "failed: module_refused (code 3); it said no",
        ),
        ({"status": "unknown", "reason": "no_reply"}, "unknown: no_reply"),
    ],
)
def test_a_verdict_in_words(verdict: dict[str, Any], words: str) -> None:
    """Status, reason, and what else the verdict says."""
    assert outcome(verdict) == words


def test_its_arguments_have_help() -> None:
    """The frame shows them."""
    parser = argparse.ArgumentParser()
    send.add_arguments(parser)
    assert "1=ON,4=OFF" in parser.format_help()
