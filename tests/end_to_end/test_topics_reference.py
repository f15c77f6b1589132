"""docs/topics.md against what a running bridge publishes."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from support.daemon import Daemon
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, broker, is_complete, panel, write_config
from support.topics_reference import example_with, forms, matches

from bridge.model import LineProtocol

PUBLISHED = forms("What the bridge publishes")
EXTRAS = (
    "inputs: {1: {gestures: {long: 60s, double: 0s}, count: true}}, outputs: {1: {max_on: 1s}}, "
    "covers: {blind: {open: 6, close: 7, open_time: 1s, close_time: 1s}}"
)
RULE = "rules: [{name: Bell, when: garage/di/1, is: ON, then: {garage/do/4: ON}}]"
# Only where the configuration, or somebody, asks for it: it is asked for here.
REQUESTED = {
    "garage/cover/blind/set": "OPEN",
    "bridge/request/trace": '{"line": "main"}',
    "bridge/request/reload": '{"id": "r1"}',
    "nobody/set": "ON",  # the log names it
    "pumps/do/3/set": '{"state": "ON", "id": "x1"}',
    "garage/do/1/set": "ON",  # its time ends
}

EXAMPLES = {
    "bridge/line/main/diagnostics": example_with("cycle_ms"),
    "garage/diagnostics": example_with("poll_ms"),
    "bridge/line/main/trace": example_with("gap_ms"),
    "pumps/result": example_with("target"),
    "garage/own_actions": example_with("last", "actions"),
    "bridge/response/reload": example_with("status", "data", "id"),
}


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Seen]]:
    """All that a bridge publishes below its base topic until each form was there once."""
    directory = tmp_path_factory.mktemp("house")
    with panel(LineProtocol.MODBUS_RTU) as line, broker(directory) as mosquitto:
        config = write_config(directory, line, mosquitto.port)
        text = config.read_text()
        text = text.replace("id: garage", f"id: garage, {EXTRAS}")
        config.write_text(f"{text}\n{RULE}\n")
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config):
            probe.wait_for(is_complete)
            for value, word in ((True, "ON"), (False, "OFF")):
                line.module(1).set_input(1, value)
                probe.wait_message(f"{BASE}/garage/di/1", word)
            for topic, payload in REQUESTED.items():
                probe.publish(f"{BASE}/{topic}", payload)
            yield probe.wait_for(lambda seen: not _missing(seen))


def _missing(seen: list[Seen]) -> list[str]:
    topics = {message.topic for message in seen}
    forms_missing = [f for f in PUBLISHED if not any(matches(f, t, BASE) for t in topics)]
    return [*forms_missing, *({f"{BASE}/{topic}" for topic in EXAMPLES} - topics)]


def _latest(published: list[Seen], topic: str) -> dict[str, Any]:
    """The newest JSON payload on a topic."""
    payloads = [message.payload for message in published if message.topic == f"{BASE}/{topic}"]
    document: dict[str, Any] = json.loads(payloads[-1])
    return document


def test_every_topic_of_a_running_bridge_is_in_the_reference(published: list[Seen]) -> None:
    """Every topic of a running bridge is in docs/topics.md, and each form there is published."""
    ours = {message.topic for message in published} - {f"{BASE}/{topic}" for topic in REQUESTED}
    strangers = [t for t in ours if not any(matches(form, t, BASE) for form in PUBLISHED)]
    assert strangers == []


@pytest.mark.parametrize("topic", EXAMPLES)
def test_an_example_has_the_keys_of_the_real_payload(published: list[Seen], topic: str) -> None:
    """The keys, and those of the objects in it."""
    assert _keys(_latest(published, topic)) == _keys(EXAMPLES[topic])


def _keys(document: dict[str, Any]) -> dict[str, Any]:
    return {
        key: _keys(value) if isinstance(value, dict) else None for key, value in document.items()
    }
