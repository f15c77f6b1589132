"""One connection to the broker, from CONNECT to its end. The only importer of paho-mqtt.

Each connection has a paho client of its own, so that nothing that was queued or in flight when
one ended can be sent again by the next. Callbacks note and hand on: they neither wait nor raise.
"""

import logging
import os
import select
import socket
import ssl
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from typing import Any

from paho.mqtt.client import Client, DisconnectFlags, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from bridge.bounded_log import BoundedLog, Cause
from bridge.config.schema import MqttConfig, TlsConfig
from bridge.mqtt.events import (
    Acknowledged,
    MqttEvent,
    OutMessage,
    Received,
    Subscribed,
    Subscription,
)
from bridge.mqtt.reconnect import Ended, Ending

# paho asks after one of these, and gives up after the second: a black hole is noticed in 30 s.
_KEEPALIVE_S = 14
# Events that nobody has handled yet: beyond so many no more is read, and looked again so soon.
# A burst of 10,000 commands is taken in at once: what is read counts as arrived, and ages.
_MOST_BACKLOG = 16_384
_SWAMPED_S = 0.01
_WINDOW = 100  # QoS 1 messages on their way; a v5 broker may allow fewer
_NAMED_TOPICS = 1000  # a requester chooses response topics: what is remembered is bounded
_KINDS = {
    *("state", "info", "availability", "diagnostics", "problem", "result", "config", "set"),
    *("di", "do", "mode", "hold", "count", "event"),
}
_TLS_ALERT = " alert "  # in OpenSSL's words for what the other side did not like
_NO_LIVE_COPY = 2  # v5 retain handling: nothing that was retained before the subscription

# Reason codes of MQTT v5; paho gives the return codes of 3.1.1 as these too.
_UNSPECIFIED = 0x80
_UNSUPPORTED_VERSION = 0x84
_BAD_CREDENTIALS = (0x86, 0x87, 0x8A, 0x8C)
_SESSION_TAKEN_OVER = 0x8E


@dataclass(slots=True)
class Counters:
    """What went wrong since the start. The client's thread alone writes it."""

    connections: int = 0
    taken_over: int = 0
    failed_publishes: int = 0
    undecodable_topics: int = 0


class _LastError(logging.Logger):
    """Takes what paho tells to a logger, and keeps the error of a socket: it has no other word.

    Attributes:
        text: The last one, or None.
    """

    def __init__(self) -> None:
        super().__init__("paho", logging.ERROR)
        self.text: str | None = None

    def handle(self, record: logging.LogRecord) -> None:
        """Takes one record."""
        self.text = record.getMessage()


def _guarded(callback: Callable[..., None], log: BoundedLog) -> Callable[..., None]:
    """Keeps what a callback raises from paho's loop: one bad message must not end it."""

    @wraps(callback)
    def call(*arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:  # noqa: BLE001  # logged with its trace; the loop goes on
            text = f"the MQTT callback {callback.__name__} failed: {error!r}"
            log.tell(Cause.MESSAGE, callback.__name__, logging.ERROR, text, error=error)

    return call


class Connection:
    """One thread owns it and calls `open`, `step` and `close`.

    The others only `offer`, `subscribe`, `unsubscribe` and `wake`.

    Attributes:
        ready: The broker answered all subscriptions.
        subscribed_at: Monotonic; nothing that arrives was taken in by the broker before this.
        denied: The filters that it refused, and why.
        ended: How it ended, or None while it lives.
    """

    def __init__(
        self,
        config: MqttConfig,
        *,
        protocol: str,
        subscriptions: Sequence[Subscription],
        will: OutMessage | None,
        emit: Callable[[MqttEvent], None],
        counters: Counters,
        attempt_s: float,
        backlog: Callable[[], int],
        log: BoundedLog,
    ) -> None:
        """Args: `backlog` tells how many events nobody has handled yet."""
        self.ready = False
        self.subscribed_at = 0.0
        self.denied: dict[str, str] = {}
        self.ended: Ended | None = None
        self._config = config
        self._v5 = protocol == "5"
        self._subscriptions = subscriptions
        self._emit = emit
        self._counters = counters
        self._attempt_s = attempt_s
        self._backlog = backlog
        self._log = log
        self._ready_by = 0.0
        self._window = _WINDOW
        self._answered = False
        self._outgoing: deque[Callable[[], object]] = deque()
        self._asked: dict[int | None, Sequence[Subscription]] = {}  # by paho's message id
        self._unacknowledged: dict[int, tuple[int, str]] = {}  # paho's message id: token, topic
        self._named: set[str] = set()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._errors = _LastError()
        self._paho = self._make_paho(will)

    # --- for any thread ---------------------------------------------------------------------

    @property
    def usable(self) -> bool:
        """It is ready and has not ended."""
        return self.ready and self.ended is None

    def offer(self, token: int, message: OutMessage) -> None:
        """Queues a message for the next `step`. Never blocks."""
        self._offer(partial(self._publish, token, message))

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """Asks for more, as long as this connection lasts: `Subscribed` answers. Never blocks."""
        self._offer(partial(self._subscribe, subscriptions))

    def unsubscribe(self, topic_filters: Sequence[str]) -> None:
        """Asks for less. Never blocks."""
        self._offer(partial(self._paho.unsubscribe, list(topic_filters)))

    def wake(self) -> None:
        """Ends the wait of a running `step`."""
        os.eventfd_write(self._wake, 1)

    # --- for the thread that owns it --------------------------------------------------------

    @property
    def idle(self) -> bool:
        """Everything that was offered is written, and acknowledged where that is due."""
        return not (self._outgoing or self._unacknowledged or self._paho.want_write())

    def open(self) -> None:
        """Connects and sends CONNECT: blocks for the deadlines of name, TCP and TLS at most."""
        try:
            self._set_tls(self._config.tls)
            if self._v5:
                self._connect(clean_start=True, properties=_no_session())
            else:
                self._connect()
        except (OSError, ValueError) as error:  # ValueError: a host that is no name at all
            self._end(Ending.UNREACHABLE, str(error))
        self._ready_by = time.monotonic() + self._attempt_s

    def step(self, timeout_s: float) -> None:
        """Waits for traffic, for offers or for `timeout_s`, and handles what is there."""
        sock: Any = self._paho.socket()
        readable, writable = self._wait(sock, timeout_s)
        if readable:
            self._paho.loop_read()
        self._hand_over()  # after the read, which may have made room
        if writable:
            self._paho.loop_write()
        self._paho.loop_misc()
        if not self.ready and time.monotonic() >= self._ready_by:
            # A broker may choke on a version that it does not know, instead of refusing it.
            ending, missing = (
                (Ending.UNREACHABLE, "SUBACK") if self._answered else (Ending.NO_ANSWER, "CONNACK")
            )
            self._end(ending, f"no {missing} within {self._attempt_s:g} s")

    def close(self) -> Ended:
        """Says DISCONNECT where the connection still lives, gives all back, tells its end."""
        if self.ended is None:
            self.ended = Ended(Ending.STOPPED, "stopped")
            self._paho.disconnect()
        sock = self._paho.socket()
        if sock is not None:
            sock.close()
        os.close(self._wake)
        return self.ended

    # --- the inside -------------------------------------------------------------------------

    def _make_paho(self, will: OutMessage | None) -> Client:
        version = MQTTProtocolVersion.MQTTv5 if self._v5 else MQTTProtocolVersion.MQTTv311
        paho = Client(
            CallbackAPIVersion.VERSION2,
            self._config.client_id,
            clean_session=None if self._v5 else True,
            protocol=version,
            reconnect_on_failure=False,  # paho would go on to MQTT 3.1 by itself
        )
        paho.max_inflight_messages = 0  # the window is ours: it keeps the order with QoS 0
        paho.connect_timeout = self._attempt_s
        paho.username_pw_set(self._config.username, self._config.password)
        if will is not None:
            paho.will_set(will.topic, will.payload, will.qos, will.retain)
        paho.enable_logger(self._errors)
        paho.on_connect = _guarded(self._on_connect, self._log)
        paho.on_subscribe = _guarded(self._on_subscribe, self._log)
        paho.on_publish = _guarded(self._on_publish, self._log)
        paho.on_message = _guarded(self._on_message, self._log)
        paho.on_disconnect = _guarded(self._on_disconnect, self._log)
        return paho

    def _set_tls(self, tls: TlsConfig | None) -> None:
        if tls is None:
            return
        # The files are read at each attempt: a renewed certificate needs no restart.
        context = ssl.create_default_context(cafile=tls.ca)
        if tls.cert is not None:
            context.load_cert_chain(tls.cert, tls.key)
        self._paho.tls_set_context(context)

    def _connect(self, **version_5: Any) -> None:
        self._paho.connect(self._config.host, self._config.port, _KEEPALIVE_S, **version_5)
        sock: Any = self._paho.socket()
        if sock is not None:
            # A small message must not wait for the acknowledgement of the one before it.
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _wait(self, sock: Any, timeout_s: float) -> tuple[bool, bool]:
        # Not taken off the socket, a flood waits at its sender: our memory is bounded.
        swamped = self._backlog() > _MOST_BACKLOG
        # What TLS has already decrypted does not make the socket readable.
        pending = not swamped and isinstance(sock, ssl.SSLSocket) and sock.pending() > 0
        readable, writable, _ = select.select(
            [self._wake] if swamped else [sock, self._wake],
            [sock] if self._paho.want_write() else [],
            [],
            0.0 if pending else min(timeout_s, _SWAMPED_S) if swamped else timeout_s,
        )
        if self._wake in readable:
            os.eventfd_read(self._wake)
        return pending or sock in readable, sock in writable

    def _hand_over(self) -> None:
        while self._outgoing and len(self._unacknowledged) < self._window:
            self._outgoing.popleft()()

    def _offer(self, deed: Callable[[], object]) -> None:
        self._outgoing.append(deed)
        self.wake()

    def _publish(self, token: int, message: OutMessage) -> None:
        try:
            info = self._paho.publish(
                message.topic,
                message.payload,
                message.qos,
                message.retain,
                _publish_properties(message) if self._v5 else None,
            )
        except ValueError as error:  # a topic that MQTT does not allow
            self._failed_publish(message.topic, str(error))
            if message.qos > 0:
                self._emit(Acknowledged(token))
            return
        if message.qos > 0:
            self._unacknowledged[info.mid] = (token, message.topic)

    def _failed_publish(self, topic: str, reason: str) -> None:
        self._counters.failed_publishes += 1
        if topic not in self._named and len(self._named) < _NAMED_TOPICS:
            self._named.add(topic)
            text = f"the broker did not take a message to {topic!r}: {reason}"
            self._log.tell(Cause.BROKER_DENIES, _kind_of(topic), logging.WARNING, text)

    def _end(self, ending: Ending, cause: str) -> None:
        if self.ended is None:  # what came first is the cause; the rest follows from it
            self.ended = Ended(ending, cause)

    # --- paho's callbacks, in the owner's thread --------------------------------------------

    def _on_connect(
        self, _paho: Client, _userdata: Any, _flags: Any, reason: ReasonCode, properties: Properties
    ) -> None:
        if reason.is_failure:
            self._end(_refusal(reason), f"it refused us ({reason})")
            return
        self._answered = True
        self.subscribed_at = time.monotonic()
        self._window = min(_WINDOW, getattr(properties, "ReceiveMaximum", _WINDOW))
        if self._subscriptions:
            self._subscribe(self._subscriptions)
        else:
            self.ready = True

    def _subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        _, message_id = self._paho.subscribe([self._wanted(one) for one in subscriptions])
        self._asked[message_id] = subscriptions

    def _wanted(self, one: Subscription) -> tuple[str, Any]:
        if not self._v5:
            return one.topic_filter, one.qos
        handling = _NO_LIVE_COPY if one.live_only else SubscribeOptions.RETAIN_SEND_ON_SUBSCRIBE
        options = SubscribeOptions(
            qos=one.qos, retainAsPublished=one.as_published, retainHandling=handling
        )
        return one.topic_filter, options

    def _on_subscribe(
        self, _paho: Client, _userdata: Any, mid: int, reasons: list[ReasonCode], _props: Any
    ) -> None:
        answers = zip(self._asked.pop(mid), reasons, strict=True)
        denied = {one.topic_filter: str(reason) for one, reason in answers if reason.is_failure}
        if self.ready:
            self._emit(Subscribed(tuple(denied)))
        else:
            self.denied = denied
            self.ready = True

    def _on_publish(
        self, _paho: Client, _userdata: Any, mid: int, reason: ReasonCode, _props: Any
    ) -> None:
        if mid not in self._unacknowledged:  # QoS 0: written, and nobody waits for more
            return
        token, topic = self._unacknowledged.pop(mid)
        if reason.is_failure:
            self._failed_publish(topic, str(reason))
        self._emit(Acknowledged(token))

    def _on_message(self, _paho: Client, _userdata: Any, message: MQTTMessage) -> None:
        at = time.monotonic()
        try:
            topic = message.topic
        except UnicodeDecodeError:
            self._counters.undecodable_topics += 1
            text = "dropped a message: its topic is not UTF-8"
            self._log.tell(Cause.MESSAGE, "topic", logging.WARNING, text)
            return
        properties = message.properties
        self._emit(
            Received(
                topic,
                bytes(message.payload),
                message.retain,
                at,
                response_topic=getattr(properties, "ResponseTopic", None),
                correlation=getattr(properties, "CorrelationData", None),
                expiry_s=getattr(properties, "MessageExpiryInterval", None),
            )
        )

    def _on_disconnect(
        self,
        _paho: Client,
        _userdata: Any,
        flags: DisconnectFlags,
        reason: ReasonCode,
        _props: Any,
    ) -> None:
        if flags.is_disconnect_packet_from_server:
            taken_over = reason.value == _SESSION_TAKEN_OVER
            ending = Ending.TAKEN_OVER if taken_over else Ending.LOST
            self._end(ending, f"it ended the session ({reason})")
        elif not self._answered and _TLS_ALERT in (self._errors.text or ""):
            self._end(Ending.REFUSED, str(self._errors.text))
        elif not self._answered:
            self._end(Ending.NO_ANSWER, "it closed the connection before it answered CONNECT")
        elif self._errors.text is not None:
            self._end(Ending.LOST, self._errors.text)
        elif reason.value == _UNSPECIFIED:  # paho's word for an end without an error
            self._end(Ending.HUNG_UP, "it closed the connection without a word")
        else:
            self._end(Ending.LOST, str(reason))


def accepts(config: MqttConfig, timeout_s: float) -> bool:
    """Tells whether the broker takes TCP connections just now."""
    try:
        socket.create_connection((config.host, config.port), timeout_s).close()
    except OSError:
        return False
    return True


def _kind_of(topic: str) -> str:
    """What a topic is for. A list that denies one kind to all stations hides no other kind."""
    levels = [level for level in topic.split("/")[-2:] if not level.isdecimal()]
    return levels[-1] if levels and levels[-1] in _KINDS else ""


def _no_session() -> Properties:
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho's gap
    properties.SessionExpiryInterval = 0
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


def _refusal(reason: ReasonCode) -> Ending:
    if reason.value == _UNSUPPORTED_VERSION:
        return Ending.VERSION
    return Ending.CREDENTIALS if reason.value in _BAD_CREDENTIALS else Ending.REFUSED
