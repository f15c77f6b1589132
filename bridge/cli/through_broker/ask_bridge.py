"""Sends a request to the bridge through the broker (docs/topics.md, Requests)."""

import json
import secrets
import time
from collections.abc import Generator, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from typing import Any

from bridge.cli.frame.usage import UsageError
from bridge.cli.through_broker.broker import TIMEOUT_S, Broker, at_broker
from bridge.config.schema import Config, LineConfig, MqttConfig
from bridge.errors import BridgeError
from bridge.mqtt.events import OutMessage, Received, Subscription
from bridge.mqtt.payloads import OFFLINE
from bridge.mqtt.strict_json import object_of
from bridge.mqtt.topics import Topics

_NAMES = ("line", "station")  # arguments that name the subject of a request
_PATIENCE_S = 15.0  # between two answers; a bridge at work reports every second


class Inquiry:
    """One request, and its answers."""

    def __init__(self, topics: Topics, verb: str, arguments: Mapping[str, Any]) -> None:
        self._id = secrets.token_hex(8)
        self._arguments = arguments
        self._topics = topics
        self._verb = verb

    def send(self, broker: Broker) -> None:
        """Send the request; may be called again."""
        self._publish(broker, {**self._arguments, "id": self._id})

    def stop(self, broker: Broker) -> None:
        """Ask the bridge to end its work on the request."""
        named = {key: self._arguments[key] for key in _NAMES if key in self._arguments}
        self._publish(broker, {**named, "stop": True})

    def _publish(self, broker: Broker, request: Mapping[str, Any]) -> None:
        topic = self._topics.request(self._verb)
        broker.publish(OutMessage(topic, json.dumps(request).encode(), qos=1, retain=False))

    def answer_in(self, message: Received) -> Mapping[str, Any] | None:
        """Return the content of an answer; None: the message is not an answer to the request.

        Raises:
            BridgeError: The bridge refuses, or is not running.
        """
        if message.topic == self._topics.bridge_state and message.payload == OFFLINE:
            raise BridgeError(f"the bridge is not running: {message.topic} says offline")
        if message.topic != self._topics.response(self._verb):
            return None
        document = object_of(message.payload)
        if document.get("id") != self._id:
            return None
        if document.get("status") != "ok":
            raise BridgeError(f"the bridge says: {document.get('error')}")
        data = document.get("data")
        return data if isinstance(data, dict) else {}


def subscriptions(topics: Topics, verb: str) -> tuple[Subscription, ...]:
    """Return the subscriptions for the answers."""
    return (Subscription(topics.response(verb)), Subscription(topics.bridge_state, live_only=False))


@contextmanager
def asked(
    config: MqttConfig, verb: str, arguments: Mapping[str, Any], purpose: str = ""
) -> Iterator[Iterator[Mapping[str, Any]]]:
    """Make a request within the block, which gets the answers up to the final one.

    `purpose` is for the client id, where the verb does not say it.

    Raises:
        BridgeError: There is no broker, or as `answers`.
    """
    topics = Topics(config.base_topic)
    wanted = subscriptions(topics, verb)
    with (
        at_broker(config, purpose or verb, wanted, TIMEOUT_S) as broker,
        closing(answers(broker, Inquiry(topics, verb, arguments))) as told,
    ):
        yield told


def answers(broker: Broker, inquiry: Inquiry) -> Generator[Mapping[str, Any], None, None]:
    """Send the request and yield the answers up to the final one; Ctrl-C ends the bridge's work.

    Raises:
        BridgeError: The bridge refuses, or does not answer for a while.
    """
    inquiry.send(broker)
    try:
        yield from _answers(broker, inquiry)
    except (KeyboardInterrupt, GeneratorExit):  # the second: it came between two answers
        with suppress(BridgeError):
            inquiry.stop(broker)
        raise


def _answers(broker: Broker, inquiry: Inquiry) -> Iterator[Mapping[str, Any]]:
    until = time.monotonic() + _PATIENCE_S
    while time.monotonic() < until:
        for message in broker.messages(until):
            data = inquiry.answer_in(message)
            if data is None:
                continue
            yield data
            if data.get("final", True):
                return
            until = time.monotonic() + _PATIENCE_S
            break
    raise BridgeError(f"no answer in {_PATIENCE_S:g} s: does the bridge run, at this broker?")


def line_named(config: Config, name: str) -> LineConfig:
    """Return the line with this id.

    Raises:
        UsageError: There is none.
    """
    for line in config.lines:
        if line.id == name:
            return line
    known = ", ".join(line.id for line in config.lines)
    raise UsageError(f"there is no line {name}; there are: {known}")
