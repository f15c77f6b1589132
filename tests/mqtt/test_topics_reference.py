"""docs/topics.md against the code that writes and reads topics."""

import inspect
import re
import shlex
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest
from support.mqtt_side import GARAGE
from support.topics_reference import as_filter, examples, forms, page

from bridge.config.schema import CoverConfig, OutputConfig
from bridge.mqtt.access import CommandProbe
from bridge.mqtt.commands import parse_command
from bridge.mqtt.events import Received
from bridge.mqtt.strict_json import read_object
from bridge.mqtt.topics import CommandTarget, CoverTarget, RequestTarget, RuleTarget, Topics

TOPICS = Topics("B")
STATUS = "homeassistant/status"
FILTERS = [one.topic_filter for one in TOPICS.subscriptions(STATUS)]
# The letter that stands for an argument in the reference.
LETTERS = {
    "verb": "V",
    "line": "L",
    "station_id": "S",
    "channel": "n",
    "output": "n",
    "cover": "ID",
    "rule": "ID",
}
COMMANDS = re.findall(r"^mosquitto_pub (-t .*)$", page(), flags=re.MULTILINE)


def _written() -> Iterator[str]:
    """Every form of topic that `Topics` can write."""
    yield from (value for value in vars(TOPICS).values() if value.startswith("B/"))
    for name, method in inspect.getmembers(TOPICS, inspect.ismethod):
        signature = inspect.signature(method)
        if name.startswith("_") or signature.return_annotation is not str:
            continue
        parameters = list(signature.parameters)
        for direction in ("di", "do") if "direction" in parameters else ("",):
            yield method(*(LETTERS.get(one, direction) for one in parameters))


def _probes() -> set[str]:
    probe = CommandProbe(FILTERS, "nonce")
    probe.connected(0.0)
    return {message.topic for message in probe.due(0.0)}


def test_the_reference_tells_just_what_can_be_published() -> None:
    """Each form that the code writes stands there, and none besides."""
    told = forms("What the bridge publishes")
    assert len(told) == len(set(told))
    for_others = {
        form for form in _written() if as_filter(form) in FILTERS and "+" in as_filter(form)
    }
    assert set(told) == {*_written(), *_probes()} - for_others


def test_the_reference_tells_just_what_is_listened_to() -> None:
    """Each filter stands there, but for the bridge's own topics that come back."""
    told = {as_filter(form) for form in forms("What the bridge listens to")}
    assert told == set(FILTERS) - {STATUS, TOPICS.bridge_state, TOPICS.ping}


def test_what_is_listened_to_is_understood() -> None:
    """A topic of each form means something to the bridge."""
    for form in forms("What the bridge listens to"):
        meaning = TOPICS.parse(form)
        assert isinstance(meaning, CommandTarget | CoverTarget | RuleTarget | RequestTarget)


def test_there_are_examples() -> None:
    """The tests of examples cannot pass by finding nothing."""
    assert len(COMMANDS) > 5
    assert len(examples()) > 5


@pytest.mark.parametrize("line", COMMANDS)
def test_an_example_of_a_command_is_taken(line: str) -> None:
    """Topic and payload are those of a command, or of a request, that the bridge takes."""
    arguments = shlex.split(line)
    topic, payload = arguments[1], arguments[arguments.index("-m") + 1].encode()
    match Topics("wisco").parse(topic):
        case RequestTarget(verb):
            assert f"| `{verb}` |" in page()
            assert read_object(payload.decode())
        case CommandTarget() | CoverTarget() as target:
            outputs = tuple(OutputConfig(n) for n in range(1, 17))
            shutter = CoverConfig("shutter", "Shutter", open=6, close=7, open_s=20.0, close_s=18.0)
            config = replace(GARAGE, outputs=outputs, covers=(shutter,))
            received = Received(topic, payload, retain=False, at=time.monotonic())
            command = parse_command(target, received, config, Topics("wisco"))
            assert command.target == target.name
        case other:
            pytest.fail(f"{topic} means {other}")
