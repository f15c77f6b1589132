"""Connects a command to the broker of the configuration, as a second client beside the bridge."""

import argparse
import logging
import os
import queue
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from bridge.config.schema import MqttConfig
from bridge.errors import BridgeError
from bridge.mqtt.backlog import EventQueue
from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import Connected, MqttEvent, OutMessage, Received, Subscription

TIMEOUT_S = 10.0
_STOP_S = 2.0
_GLANCE_S = 0.1  # how often refusals are looked for
_LOOK_S = 1.0  # how often it is checked that the client lives: a dead client emits nothing


class Broker:
    """The connection of a command to the broker. Use `at_broker`."""

    def __init__(self, client: MqttClient, events: EventQueue[MqttEvent]) -> None:
        self._client = client
        self._events = events

    def publish(self, message: OutMessage) -> None:
        """Send a message.

        Raises:
            BridgeError: The connection was lost.
        """
        if self._client.publish(message) is None:
            raise BridgeError(self._client.trouble or "the connection to the broker was lost")

    def messages(self, until: float = float("inf")) -> Iterator[Received]:
        """Yield messages until the instant `until` (`time.monotonic`), over reconnects too.

        Raises:
            BridgeError: The client died.
        """
        while (rest_s := until - time.monotonic()) > 0:
            try:
                event = self._events.get(timeout=min(rest_s, _LOOK_S))
            except queue.Empty:
                if not self._client.alive():
                    raise BridgeError(f"the MQTT client died: {self._client.failure}") from None
                continue
            if isinstance(event, Received):
                yield event


@contextmanager
def at_broker(
    config: MqttConfig,
    purpose: str,
    subscriptions: Sequence[Subscription],
    timeout_s: float,
    *,
    patient: bool = False,
) -> Iterator[Broker]:
    """Connect with a client id of our own; disconnect at the end.

    `patient`: a broker that is away is tried again until `timeout_s` is over.

    Raises:
        BridgeError: There was no connection within `timeout_s`, or username and password were
            refused; the message says why.
    """
    events: EventQueue[MqttEvent] = EventQueue()
    connected = threading.Event()

    def emit(event: MqttEvent) -> None:
        events.put(event)
        if isinstance(event, Connected):
            connected.set()

    own = replace(config, client_id=f"{config.client_id}-{purpose}-{os.getpid()}")
    client = MqttClient(own, subscriptions, emit, None, backlog=events.backlog)
    with _quiet_until(connected, client), _running(client):
        _wait(connected, client, own, timeout_s, patient=patient)
        yield Broker(client, events)


def _wait(
    connected: threading.Event,
    client: MqttClient,
    config: MqttConfig,
    timeout_s: float,
    *,
    patient: bool,
) -> None:
    servers = ", ".join(str(server) for server in config.servers)
    silence = f"no answer of the broker at {servers} in {timeout_s:g} s"
    until = time.monotonic() + timeout_s
    while not connected.wait(min(_GLANCE_S, max(0.0, until - time.monotonic()))):
        # A refused password will be refused again; a broker that is away may come back.
        tries_on = not client.rejected and (patient or client.asks_for_less)
        hopeless = client.trouble is not None and not tries_on
        if hopeless or time.monotonic() >= until:
            raise BridgeError(client.trouble or f"{silence}; check mqtt.host and mqtt.port")


@contextmanager
def _running(client: MqttClient) -> Iterator[None]:
    client.start()
    try:
        yield
    finally:
        client.stop(_STOP_S)


@contextmanager
def _quiet_until(connected: threading.Event, client: MqttClient) -> Iterator[None]:
    # Until the connection the message of the command says what is wrong; later the log does.
    def wanted(record: logging.LogRecord) -> bool:
        denied = record.levelno >= logging.WARNING and client.connected
        return denied or connected.is_set()

    logger = logging.getLogger(MqttClient.__module__)
    logger.addFilter(wanted)
    try:
        yield
    finally:
        logger.removeFilter(wanted)


def add_timeout(parser: argparse.ArgumentParser) -> None:
    """Declare the option for the time-out of `at_broker`."""
    parser.add_argument(
        "--timeout",
        type=float,
        metavar="SECONDS",
        help="how long to try to reach a broker that is away (default: once)",
    )
