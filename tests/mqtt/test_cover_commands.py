import json
from typing import Any

import pytest
from support.covers import cover_station
from support.mqtt_side import GARAGE

from bridge.model import CoverCommand, Reason
from bridge.mqtt.commands import BadCommandError, parse_command
from bridge.mqtt.events import Received
from bridge.mqtt.topics import CoverTarget, Topics

WORDS = CoverTarget("garage", "shutter")
POSITION = CoverTarget("garage", "shutter", position=True)


def _parse(payload: str | bytes, target: CoverTarget) -> CoverCommand:
    data = payload.encode() if isinstance(payload, str) else payload
    received = Received("any", data, retain=False, at=100.0)
    command = parse_command(target, received, cover_station(GARAGE), Topics("wisco"))
    assert isinstance(command, CoverCommand)
    return command


def _error_of(payload: str | bytes, target: CoverTarget) -> BadCommandError:
    with pytest.raises(BadCommandError) as caught:
        _parse(payload, target)
    return caught.value


@pytest.mark.parametrize(("word", "goal"), [("OPEN", 100), ("CLOSE", 0), ("STOP", None)])
def test_a_word(word: str, goal: int | None) -> None:
    """Bare or in JSON it asks for the same."""
    command = _parse(word, WORDS)
    assert command == CoverCommand(
        "garage", "cover/shutter", word, "shutter", 0b11, goal, arrived=100.0, deadline=102.0
    )
    request = {"state": word, "id": "x1", "deadline": 1.5}
    command = _parse(json.dumps(request), WORDS)
    assert (command.payload, command.goal, command.id) == (word, goal, "x1")
    assert command.deadline == 101.5


@pytest.mark.parametrize("position", [0, 1, 42, 100])
def test_a_position(position: int) -> None:
    """In whole percent, bare or in JSON."""
    for payload in (str(position), json.dumps({"position": position})):
        command = _parse(payload, POSITION)
        assert (command.goal, command.payload) == (position, position)
        assert command.target == "cover/shutter"


@pytest.mark.parametrize(
    ("payload", "target"),
    [
        ("open", WORDS),
        ("ON", WORDS),
        ("TOGGLE", WORDS),
        ("50", WORDS),
        ('{"state": "UP"}', WORDS),
        ('{"state": ["OPEN"]}', WORDS),
        ('{"position": 50}', WORDS),
        ('{"state": "OPEN", "speed": 1}', WORDS),
        (b"\xff", WORDS),
        ("", WORDS),
        ("OPEN", POSITION),
        ("101", POSITION),
        ("-1", POSITION),
        ("50.5", POSITION),
        ('{"position": 50.5}', POSITION),
        ('{"position": true}', POSITION),
        ('{"position": "50"}', POSITION),
        ('{"position": 101}', POSITION),
        ('{"position": NaN}', POSITION),
    ],
)
def test_what_is_no_wish_is_refused(payload: Any, target: CoverTarget) -> None:
    """Words are upper case, positions are whole numbers from 0 to 100."""
    assert _error_of(payload, target).reason == Reason.BAD_PAYLOAD


def test_a_cover_that_is_not_there() -> None:
    """It is named, in a message that cannot grow."""
    error = _error_of('{"state": "OPEN", "id": "x"}', CoverTarget("garage", "roof" * 100))
    assert error.reason == Reason.NO_SUCH_CHANNEL
    assert (error.payload, error.id) == ("OPEN", "x")
    assert "roof" in error.detail
    assert len(error.detail) < 100
