"""How `watch` tells changes in words."""

from datetime import UTC, datetime

import pytest
from support.config_file import file_with, load_text

from bridge.cli.views.watch_view import MessageWords
from bridge.config.schema import Config
from bridge.mqtt.events import Received

NOON = datetime(2024, 5, 1, 13, 34, 6, tzinfo=UTC)


@pytest.fixture
def config(tmp_path_factory: pytest.TempPathFactory) -> Config:
    """A DIO100 `garage` with a door and a lamp."""
    names = "id: garage\ninputs: {1: {name: Door}}\noutputs: {1: {name: Lamp}}"
    return load_text(tmp_path_factory.mktemp("config"), file_with(station_keys=names))


def told(config: Config | None, topic: str, payload: str, *, colour: bool = False) -> str | None:
    """The line of one message."""
    message = Received(f"wisco/{topic}", payload.encode(), retain=False, at=0.0)
    return MessageWords(config, "wisco", colour=colour).line(message, NOON)


@pytest.mark.parametrize(
    ("topic", "payload", "words"),
    [
        ("garage/di/1", "ON", "garage    input 1 Door          ON"),
        ("garage/do/1", "OFF", "garage    output 1 Lamp         OFF"),
        ("garage/do/2/mode", "pulse", "garage    output 2              mode pulse"),
        ("garage/do/2/hold", "0.5", "garage    output 2              hold time 0.5 s"),
        ("garage/di/2/count", "17", "garage    input 2               counted 17"),
        (
            "garage/di/2/event",
            '{"event_type": "short"}',
            "garage    input 2               short press",
        ),
        ("garage/cover/gate/state", "opening", "garage    cover gate            opening"),
        ("garage/cover/gate/position", "40", "garage    cover gate            at 40 %"),
        ("garage/availability", "offline", "garage                          offline"),
        ("bridge/line/main/availability", "online", "bridge    line main             online"),
        ("garage/problem", '{"state": "OFF"}', "garage                          no problem"),
        (
            "garage/result",
            '{"target": "do", "payload": {"1": "ON", "4": "OFF"}, "status": "done", "ms": 41}',
            "garage    do 1=ON,4=OFF         done in 41 ms",
        ),
        (
            "bridge/log",
            '{"level": "warning", "message": "no ping"}',
            "bridge                          warning: no ping",
        ),
    ],
)
def test_a_change_is_a_line_in_words(config: Config, topic: str, payload: str, words: str) -> None:
    """Time of day, who, what with its name, and the value, in columns."""
    assert told(config, topic, payload) == f"13:34:06 {words}"


@pytest.mark.parametrize(
    "topic", ["garage", "garage/diagnostics", "bridge/info", "bridge/line/main/diagnostics"]
)
def test_what_is_no_change_is_not_told(config: Config, topic: str) -> None:
    """Snapshots repeat what the channels said, and diagnostics are for --all."""
    assert told(config, topic, "{}") is None


def test_without_a_configuration_there_are_no_names() -> None:
    """The rest is the same."""
    assert told(None, "garage/di/1", "ON") == "13:34:06 garage    input 1               ON"


def test_colours_are_for_terminals(config: Config) -> None:
    """ON is green."""
    assert str(told(config, "garage/di/1", "ON", colour=True)).endswith("\x1b[32mON\x1b[0m")


@pytest.mark.parametrize("payload", ["[", "[1]", "x" * 10_000, "\x1b[2J", ""])
@pytest.mark.parametrize("topic", ["garage/di/1", "garage/result", "garage/problem", "bridge/log"])
def test_no_payload_breaks_a_line(config: Config, topic: str, payload: str) -> None:
    """Anyone may write to a broker."""
    line = told(config, topic, payload)
    assert line is not None
    assert line.isprintable()
