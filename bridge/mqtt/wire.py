"""MQTT on one connection, as plain values. Only this file imports paho-mqtt.

Each connection has its own paho client, so that messages that were queued or unacknowledged at its
end cannot be sent by the next one.
"""

import logging
import socket
import ssl
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import wraps
from typing import Any, Protocol

from paho.mqtt.client import Client, DisconnectFlags, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from bridge.bounded_log import BoundedLog, Cause
from bridge.clock import boot_s
from bridge.config.schema import MqttConfig, TlsConfig
from bridge.mqtt.broker_limits import BrokerLimits
from bridge.mqtt.events import OutMessage, Received, Subscription
from bridge.mqtt.incoming import MOST_PACKET_BYTES, IncomingGuard
from bridge.mqtt.refusals import Answer

# The same logger as the client: what it says of the broker is not published through the broker.

# paho pings after this time and gives up after the same time again: a dead link is noticed in 30 s.
_KEEPALIVE_S = 14
_QUICKACK: int | None = getattr(socket, "TCP_QUICKACK", None)  # Linux alone has it
_NO_LIVE_COPY = 2  # v5 retain handling: no retained messages from before the subscription


class Told(Protocol):
    """The callbacks of a wire, called in the thread that calls `read`, `write` and `misc`."""

    def connected(self, answer: Answer, limits: BrokerLimits) -> None:
        """Handle the broker's answer to CONNECT."""

    def subscribed(self, message_id: int, answers: Sequence[Answer]) -> None:
        """Handle the broker's answer to SUBSCRIBE, filter by filter."""

    def published(self, message_id: int, answer: Answer) -> None:
        """Record that a message is written (QoS 0) or answered."""

    def arrived(self, message: Received | None, cut_bytes: int) -> None:
        """Handle an arrived message; None: its topic is not UTF-8.

        `cut_bytes` is the length of its packet if it was too long and was shortened, else 0.
        """

    def closed(self, answer: Answer, error: str | None, *, by_broker: bool) -> None:
        """Handle the end of the connection: by DISCONNECT (`by_broker`), or with an `error`."""


class _LastError(logging.Logger):
    """Takes the log records of paho, to keep the error of a socket: paho reports it only there."""

    def __init__(self) -> None:
        super().__init__("paho", logging.ERROR)
        self.text: str | None = None

    def handle(self, record: logging.LogRecord) -> None:
        """Handle one record."""
        self.text = record.getMessage()


class _Client(Client):
    """paho's client, which reads through a guard. Four names of it are paho's own affair.

    `_sock_recv` is how it reads its socket, `_create_socket_connection` how it opens one,
    `_last_bytes_received` and `_keepalive` are what it judges a silent broker by.
    """

    def __init__(self, client_id: str, address: str | None, *, v5: bool) -> None:
        super().__init__(
            CallbackAPIVersion.VERSION2,
            client_id,
            clean_session=None if v5 else True,
            protocol=MQTTProtocolVersion.MQTTv5 if v5 else MQTTProtocolVersion.MQTTv311,
            reconnect_on_failure=False,  # paho would try MQTT 3.1 by itself
        )
        self.guard = IncomingGuard(super()._sock_recv, has_properties=v5)
        self._address = address

    def _create_socket_connection(self) -> socket.socket:
        """Connect to one address of the host, whose name stays the one of its certificate."""
        where = (self._address or self.host, self.port)
        return socket.create_connection(where, self.connect_timeout)

    def _sock_recv(self, bufsize: int) -> bytes:
        if self.guard.cut_bytes:  # paho does not see the dropped bytes
            self._last_bytes_received = time.monotonic()
        return self.guard.read(bufsize)

    def keep_our_keepalive(self) -> None:
        """Keep our keepalive: a broker may allow hours, and a shorter one does no harm."""
        self._keepalive = min(self._keepalive or _KEEPALIVE_S, _KEEPALIVE_S)


def guarded(callback: Callable[..., None], log: BoundedLog) -> Callable[..., None]:
    """Return a callback whose errors do not reach the loop of paho, which they would end."""

    @wraps(callback)
    def call(*arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:  # noqa: BLE001  # logged with its trace; the loop goes on
            text = f"the MQTT callback {callback.__name__} failed: {error!r}"
            log.tell(Cause.MESSAGE, callback.__name__, logging.ERROR, text, error=error)

    return call


class Wire:
    """One connection of paho. One thread owns it. Callbacks only pass events on."""

    def __init__(
        self,
        config: MqttConfig,
        *,
        address: str | None = None,
        v5: bool,
        will: OutMessage | None,
        timeout_s: float,
        told: Told,
        log: BoundedLog,
    ) -> None:
        self._config = config
        self._v5 = v5
        self._told = told
        self._errors = _LastError()
        self._paho = _Client(config.client_id, address, v5=v5)
        self._paho.max_inflight_messages = 0  # the window is ours: it keeps the order with QoS 0
        self._paho.connect_timeout = timeout_s
        self._paho.username_pw_set(config.username, config.password)
        if will is not None:
            self._paho.will_set(will.topic, will.payload, will.qos, will.retain)
        self._paho.enable_logger(self._errors)
        self._paho.on_connect = guarded(self._on_connect, log)
        self._paho.on_subscribe = guarded(self._on_subscribe, log)
        self._paho.on_publish = guarded(self._on_publish, log)
        self._paho.on_message = guarded(self._on_message, log)
        self._paho.on_disconnect = guarded(self._on_disconnect, log)

    @property
    def socket(self) -> Any:
        """Return the socket, or None: it is closed."""
        return self._paho.socket()

    @property
    def wants_to_write(self) -> bool:
        """Return whether bytes wait for room in the socket."""
        return self._paho.want_write()

    def open(self) -> None:
        """Connect and send CONNECT: blocks until the deadlines of name, TCP and TLS at most.

        Raises:
            OSError: There is no connection.
            ValueError: The host is not a valid name.
        """
        self._set_tls(self._config.tls)
        more: dict[str, Any] = {}
        if self._v5:
            more = {"clean_start": True, "properties": _no_session()}
        self._paho.connect(self._config.host, self._config.port, _KEEPALIVE_S, **more)
        if self.socket is not None:
            # A small message must not wait for the acknowledgement of the one before it.
            self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read(self) -> None:
        """Take what is there, and have the kernel acknowledge it at once.

        A broker that does not set TCP_NODELAY sends nothing more before that, and the kernel
        waits up to 40 ms. It falls back to waiting by itself, so it is told after each read.
        """
        self._paho.loop_read()
        if self.socket is not None and _QUICKACK is not None:
            with suppress(OSError):  # it broke meanwhile: the next read says so
                self.socket.setsockopt(socket.IPPROTO_TCP, _QUICKACK, 1)

    def write(self) -> None:
        """Send what waits."""
        self._paho.loop_write()

    def misc(self) -> None:
        """Send a keepalive ping if one is due."""
        self._paho.loop_misc()

    def publish(self, message: OutMessage) -> tuple[int, bool]:
        """Send a message; return its id, and whether it is written already.

        Raises:
            ValueError: MQTT does not allow its topic.
        """
        properties = _publish_properties(message) if self._v5 else None
        info = self._paho.publish(
            message.topic, message.payload, message.qos, message.retain, properties
        )
        # With an error, for example if the message before it found the connection broken, paho
        # raises.
        sent = info.rc == MQTTErrorCode.MQTT_ERR_SUCCESS
        return info.mid, message.qos == 0 and sent and info.is_published()

    def subscribe(self, subscriptions: Sequence[Subscription]) -> int | None:
        """Send one SUBSCRIBE; return its id."""
        return self._paho.subscribe([self._wanted(one) for one in subscriptions])[1]

    def unsubscribe(self, topic_filters: Sequence[str]) -> None:
        """Send one UNSUBSCRIBE."""
        self._paho.unsubscribe(list(topic_filters))

    def disconnect(self) -> None:
        """Say DISCONNECT."""
        self._paho.disconnect()

    def _set_tls(self, tls: TlsConfig | None) -> None:
        if tls is None:
            return
        # The files are read at each attempt: a renewed certificate needs no restart.
        context = ssl.create_default_context(cafile=tls.ca)
        if tls.cert is not None:
            context.load_cert_chain(tls.cert, tls.key)
        self._paho.tls_set_context(context)

    def _wanted(self, one: Subscription) -> tuple[str, Any]:
        if not self._v5:
            return one.topic_filter, one.qos
        handling = _NO_LIVE_COPY if one.live_only else SubscribeOptions.RETAIN_SEND_ON_SUBSCRIBE
        options = SubscribeOptions(
            qos=one.qos, retainAsPublished=one.as_published, retainHandling=handling
        )
        return one.topic_filter, options

    # --- paho's callbacks ---------------------------------------------------------------------

    def _on_connect(
        self, _paho: Client, _userdata: Any, _flags: Any, reason: ReasonCode, properties: Properties
    ) -> None:
        self._paho.keep_our_keepalive()
        self._told.connected(_answer(reason), BrokerLimits.of(properties))

    def _on_subscribe(
        self, _paho: Client, _userdata: Any, mid: int, reasons: list[ReasonCode], _props: Any
    ) -> None:
        self._told.subscribed(mid, [_answer(reason) for reason in reasons])

    def _on_publish(
        self, _paho: Client, _userdata: Any, mid: int, reason: ReasonCode, _props: Any
    ) -> None:
        self._told.published(mid, _answer(reason))

    def _on_message(self, _paho: Client, _userdata: Any, message: MQTTMessage) -> None:
        at = boot_s()
        cut_bytes = self._paho.guard.cut_bytes
        try:
            topic = message.topic
        except UnicodeDecodeError:
            self._told.arrived(None, cut_bytes)
            return
        properties = message.properties
        received = Received(
            topic,
            bytes(message.payload),
            message.retain,
            at,
            response_topic=getattr(properties, "ResponseTopic", None),
            correlation=getattr(properties, "CorrelationData", None),
            expiry_s=getattr(properties, "MessageExpiryInterval", None),
        )
        self._told.arrived(received, cut_bytes)

    def _on_disconnect(
        self,
        _paho: Client,
        _userdata: Any,
        flags: DisconnectFlags,
        reason: ReasonCode,
        _props: Any,
    ) -> None:
        by_broker = flags.is_disconnect_packet_from_server
        self._told.closed(_answer(reason), self._errors.text, by_broker=by_broker)


def accepts(host: str, port: int, timeout_s: float) -> bool:
    """Tell whether a server takes TCP connections just now."""
    try:
        socket.create_connection((host, port), timeout_s).close()
    except OSError:
        return False
    return True


def _answer(reason: ReasonCode) -> Answer:
    return Answer(reason.value, str(reason))


def _no_session() -> Properties:
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho's gap
    properties.SessionExpiryInterval = 0
    properties.MaximumPacketSize = MOST_PACKET_BYTES
    return properties


def _publish_properties(message: OutMessage) -> Properties | None:
    if message.correlation is None and message.expiry_s is None:
        return None
    properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's gap
    if message.correlation is not None:
        properties.CorrelationData = message.correlation
    if message.expiry_s is not None:
        properties.MessageExpiryInterval = message.expiry_s
    return properties
