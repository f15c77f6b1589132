"""A second MQTT client for tests: it watches topics, speaks on them, and waits for conditions."""

import secrets
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions
from support.brokers import SPEAKS_MQTT_5

WAIT_S = 20.0  # generous: a wait ends as soon as its condition holds


@dataclass(frozen=True, slots=True)
class Seen:
    """A message as it arrived.

    `retain` is as its publisher set it (v5 retain as published); on a broker that speaks 3.1.1
    alone it marks what was stored before the probe came.
    """

    topic: str
    payload: bytes
    retain: bool
    correlation: bytes | None = None

    @property
    def text(self) -> str:
        """The payload as text."""
        return self.payload.decode()


class MqttProbe:
    """Records what passes on its filters. Use it with `with`: it is subscribed from then on."""

    def __init__(
        self,
        port: int,
        *filters: str,
        username: str | None = None,
        password: str | None = None,
        qos: int = 1,
    ) -> None:
        """Args: `qos` is that of its filters: at 1, mosquitto drops what waits beyond 1,000."""
        self._port = port
        self._qos = qos
        self._filters = filters
        self._changed = threading.Condition()
        self._seen: list[Seen] = []
        self._subscribed = False
        version = MQTTProtocolVersion.MQTTv5 if SPEAKS_MQTT_5 else MQTTProtocolVersion.MQTTv311
        self._client = Client(CallbackAPIVersion.VERSION2, protocol=version)
        self._client.username_pw_set(username, password)

    def __enter__(self) -> Self:
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_message = self._on_message
        self._client.on_socket_open = _send_at_once
        self._client.reconnect_delay_set(min_delay=1, max_delay=1)
        self._client.connect("127.0.0.1", self._port)
        self._client.loop_start()
        self._wait(lambda: self._subscribed, WAIT_S, "the probe is not subscribed")
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()
        # Without this cycle the client is freed, and its sockets closed, with the last name.
        self._client.on_connect = None
        self._client.on_subscribe = None
        self._client.on_message = None

    @property
    def seen(self) -> list[Seen]:
        """Return the messages so far, oldest first."""
        with self._changed:
            return list(self._seen)

    def clear(self) -> None:
        """Forgets what arrived so far."""
        with self._changed:
            self._seen.clear()

    def publish(
        self,
        topic: str,
        payload: str | bytes,
        *,
        qos: int = 1,
        retain: bool = False,
        response_topic: str | None = None,
        correlation: bytes | None = None,
        expiry_s: int | None = None,
    ) -> None:
        """Publishes, and returns when the broker has it."""
        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's gap
        if response_topic is not None:
            properties.ResponseTopic = response_topic
        if correlation is not None:
            properties.CorrelationData = correlation
        if expiry_s is not None:
            properties.MessageExpiryInterval = expiry_s
        assert SPEAKS_MQTT_5 or properties.isEmpty(), "this takes MQTT 5"  # type: ignore[no-untyped-call]  # paho's gap
        info = self._client.publish(
            topic, payload, qos, retain, properties if SPEAKS_MQTT_5 else None
        )
        info.wait_for_publish(WAIT_S)
        assert info.is_published(), f"the broker did not take a message to {topic}"

    def wait_for(
        self, condition: Callable[[list[Seen]], bool], timeout_s: float = WAIT_S
    ) -> list[Seen]:
        """Waits until `condition` holds for all that arrived, and returns that."""
        self._wait(lambda: condition(self._seen), timeout_s, "the condition does not hold")
        return self.seen

    def wait_message(
        self, topic: str, payload: str | bytes | None = None, timeout_s: float = WAIT_S
    ) -> Seen:
        """Waits for a message on `topic` (with this payload), and returns the newest."""
        wanted = payload.encode() if isinstance(payload, str) else payload

        def matching(seen: list[Seen]) -> list[Seen]:
            return [m for m in seen if m.topic == topic and wanted in (None, m.payload)]

        self._wait(lambda: bool(matching(self._seen)), timeout_s, f"no {payload!r} on {topic}")
        return matching(self.seen)[-1]

    def _wait(self, condition: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        with self._changed:
            held = self._changed.wait_for(condition, timeout_s)
            assert held, f"{otherwise} after {timeout_s} s; seen: {self._seen}"

    def _on_connect(self, client: Client, *_: Any) -> None:
        options = SubscribeOptions(qos=self._qos, retainAsPublished=True)
        if self._filters and SPEAKS_MQTT_5:
            client.subscribe([(topic_filter, options) for topic_filter in self._filters])
        elif self._filters:
            client.subscribe([(topic_filter, self._qos) for topic_filter in self._filters])
        else:
            self._on_subscribe()

    def _on_subscribe(self, *_: Any) -> None:
        with self._changed:
            self._subscribed = True
            self._changed.notify_all()

    def _on_message(self, _client: Client, _userdata: Any, message: MQTTMessage) -> None:
        correlation = getattr(message.properties, "CorrelationData", None)
        with self._changed:
            self._seen.append(
                Seen(message.topic, bytes(message.payload), message.retain, correlation)
            )
            self._changed.notify_all()


def held_at(
    port: int, *filters: str, username: str | None = None, password: str | None = None
) -> dict[str, str]:
    """Returns what a broker retains now, as a client that comes new gets it."""
    last = f"probe/{secrets.token_hex(4)}"
    with MqttProbe(port, *filters, last, username=username, password=password) as probe:
        probe.publish(last, "")  # behind what was retained
        probe.wait_message(last)
        return {m.topic: m.text for m in probe.seen if m.retain}


def wait_for_held(
    port: int, filters: Sequence[str], condition: Callable[[dict[str, str]], bool]
) -> dict[str, str]:
    """Waits until `condition` holds for what a broker retains, and returns that."""
    give_up = time.monotonic() + WAIT_S
    while not condition(held := held_at(port, *filters)):
        assert time.monotonic() < give_up, f"retained after {WAIT_S} s: {held}"
        time.sleep(0.1)  # a broker does not tell when what it holds has changed: it is asked
    return held


def _send_at_once(_client: Client, _userdata: Any, sock: Any) -> None:
    # Without it each message waits for the acknowledgement of the one before it.
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
