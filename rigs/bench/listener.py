"""The MQTT side of the benchmark: what arrives, and when; and commands."""

import socket
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any, Self

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

_PATIENCE_S = 30.0


class Listener:
    """Notes the instant, topic and payload of every message. Use it with `with`."""

    def __init__(
        self, port: int, *, nodelay: bool = True, quickack: bool = False, qos: int = 1
    ) -> None:
        """`nodelay` False: its sockets are as the system makes them.

        `quickack`: it acknowledges at once, as `wisco2mqtt send` and `watch` do. `qos` is that of
        its commands: of QoS 1 it sends 20 at once, the others as these are acknowledged.
        """
        self._port = port
        self._nodelay = nodelay
        self._quickack = quickack
        self._qos = qos
        self._heard: list[tuple[float, str, bytes]] = []
        self._subscribed = threading.Event()
        self._client = Client(CallbackAPIVersion.VERSION2, protocol=MQTTProtocolVersion.MQTTv5)

    def __enter__(self) -> Self:
        self._client.on_connect = lambda client, *_: client.subscribe("#", qos=1)
        self._client.on_subscribe = lambda *_: self._subscribed.set()
        self._client.on_message = self._on_message
        if self._nodelay:
            self._client.on_socket_open = _send_at_once
        self._client.connect("127.0.0.1", self._port)
        self._client.loop_start()
        assert self._subscribed.wait(_PATIENCE_S), "the broker does not answer"
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def begin(self) -> None:
        """Forgets what was heard so far."""
        self._heard = []

    def heard(self) -> list[tuple[float, str, bytes]]:
        """Return the messages since `begin`."""
        return self._heard[:]

    def publish(self, topic: str, payload: str) -> float:
        """Sends a command; returns the instant just before."""
        at = time.monotonic()
        self._client.publish(topic, payload, qos=self._qos)
        return at

    def wait_until(self, condition: Callable[[set[str]], bool], patience_s: float) -> float:
        """Wait until `condition` holds for the topics heard; return the instant of the last one."""
        deadline = time.monotonic() + patience_s
        while True:
            heard = self.heard()
            if condition({topic for _, topic, _ in heard}):
                return heard[-1][0]
            assert time.monotonic() < deadline, "what is waited for does not arrive"
            time.sleep(0.02)

    def wait_online(self, stations: Iterable[int], patience_s: float = _PATIENCE_S) -> None:
        """Wait until these stations of line l0 are online."""
        online = {f"bench/l0-s{address}/availability" for address in stations}
        deadline = time.monotonic() + patience_s
        while not online <= {topic for _, topic, word in self.heard() if word == b"online"}:
            assert time.monotonic() < deadline, "not all stations are online"
            time.sleep(0.02)

    def _on_message(self, client: Client, _userdata: Any, message: MQTTMessage) -> None:
        if self._quickack:
            _acknowledge_at_once(client.socket())
        self._heard.append((time.monotonic(), message.topic, bytes(message.payload)))


def _acknowledge_at_once(sock: Any) -> None:
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)


def _send_at_once(_client: Client, _userdata: Any, sock: Any) -> None:
    # Without it each message waits for the acknowledgement of the one before it.
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
