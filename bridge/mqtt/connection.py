"""One connection to the broker, from CONNECT to its end."""

import logging
import os
import select
import ssl
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from bridge.bounded_log import BoundedLog, Cause
from bridge.clock import boot_s
from bridge.config.schema import MqttConfig
from bridge.mqtt import closing, refusals
from bridge.mqtt.asking import Asking, Refused
from bridge.mqtt.broker_limits import BrokerLimits
from bridge.mqtt.broker_memory import BrokerMemory
from bridge.mqtt.counters import Counters
from bridge.mqtt.events import (
    Acknowledged,
    MqttEvent,
    OutMessage,
    Received,
    Subscribed,
    Subscription,
)
from bridge.mqtt.incoming import MOST_PACKET_BYTES
from bridge.mqtt.reconnect import Ended, Ending
from bridge.mqtt.refusals import Answer
from bridge.mqtt.sending import Offer, SendWindow
from bridge.mqtt.wire import Wire

# With more unhandled events than this, nothing more is read until the next look. A burst of 10,000
# commands is read at once: what is read counts as arrived, and its time runs.
_MOST_BACKLOG = 16_384
_SWAMPED_S = 0.01
_TOPIC_CHARS = 128  # of such a one, in the log


class Connection:
    """One connection. Its thread owns it and calls `open`, `step` and `close`.

    Other threads only call `offer`, `subscribe`, `unsubscribe` and `wake`. The methods of
    `bridge.mqtt.wire.Told` are called by the wire within `step`.

    Attributes:
        ready: The broker answered all subscriptions.
        subscribed_at: The broker accepted nothing for us before this (`bridge.clock.boot_s`).
        denied: The filters that it refused, and why.
        limits: The limits of the broker.
        ended: How it ended, or None while it lives.
    """

    def __init__(
        self,
        config: MqttConfig,
        *,
        address: str | None = None,
        protocol: str,
        subscriptions: Sequence[Subscription],
        plain: Callable[[], Sequence[Subscription]],
        will: OutMessage | None,
        emit: Callable[[MqttEvent], None],
        counters: Counters,
        memory: BrokerMemory,
        attempt_s: float,
        backlog: Callable[[], int],
        log: BoundedLog,
    ) -> None:
        """Args: `plain` gives the subscriptions without wildcards; `backlog` tells of events.

        `address` is the one of the host that is meant; None: any.
        """
        self.ready = False
        self.subscribed_at = 0.0
        self.denied: dict[str, str] = {}
        self.limits = BrokerLimits()
        self.ended: Ended | None = None
        self._v5 = protocol == "5"
        self._command_qos = config.command_qos
        self._subscriptions = subscriptions
        self._plain = plain
        self._emit = emit
        self._counters = counters
        self._memory = memory
        self._attempt_s = attempt_s
        self._backlog = backlog
        self._log = log
        self._ready_by = 0.0
        self._answered = False
        self._left: Ended | None = None
        self._plainly_asked: set[Subscription] = set()
        self._outgoing: deque[Offer | Callable[[], object]] = deque()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._wire = Wire(
            config,
            address=address,
            v5=self._v5,
            will=memory.allowed_will(will),
            timeout_s=attempt_s,
            told=self,
            log=log,
        )
        self._asking = Asking(self._wire.subscribe, memory.filters)
        self._sending = SendWindow(
            self._wire.publish, self._acknowledged, memory, counters, log, has_properties=self._v5
        )

    # --- for any thread ---------------------------------------------------------------------

    @property
    def usable(self) -> bool:
        """Return whether it is ready and has not ended."""
        return self.ready and self.ended is None

    def offer(self, token: int, message: OutMessage) -> None:
        """Queue a message for the next `step`. Never blocks."""
        self._offer(self._sending.offer(token, message))

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """Add subscriptions to this connection; `Subscribed` answers. Never blocks."""
        self._offer(partial(self._ask_besides, subscriptions))

    def unsubscribe(self, topic_filters: Sequence[str]) -> None:
        """Remove subscriptions. Never blocks."""
        self._offer(partial(self._unsubscribe, topic_filters))

    def leave(self, ended: Ended) -> None:
        """End it so. Never blocks."""
        self._left = ended
        self.wake()

    def wake(self) -> None:
        """End the wait of a running `step`."""
        os.eventfd_write(self._wake, 1)

    # --- for the thread that owns it --------------------------------------------------------

    @property
    def idle(self) -> bool:
        """Return whether every offered message is sent, and acknowledged if it has to be."""
        return self._sending.idle and not (self._outgoing or self._wire.wants_to_write)

    def open(self) -> None:
        """Connect and send CONNECT: blocks until the deadlines of name, TCP and TLS at most."""
        try:
            self._wire.open()
        except (OSError, ValueError) as error:  # ValueError: the host is not a valid name
            self._end(Ended(Ending.UNREACHABLE, str(error)))
        self._ready_by = boot_s() + self._attempt_s

    def step(self, timeout_s: float) -> None:
        """Wait for traffic, offers or `timeout_s`; handle what is there."""
        readable, writable = self._wait(self._wire.socket, timeout_s)
        if readable:
            self._wire.read()
        self._hand_over()  # after the read, which may have made room
        if writable:
            self._wire.write()
        self._wire.misc()
        if self._left is not None and self.ended is None:
            self._end(self._left)
            self._wire.disconnect()  # it may live: then it does not publish the last will
        if not self.ready and boot_s() >= self._ready_by:
            # A broker may close at a version that it does not know, instead of refusing it.
            ending, missing = (
                (Ending.UNREACHABLE, "SUBACK") if self._answered else (Ending.NO_ANSWER, "CONNACK")
            )
            self._end(Ended(ending, f"no {missing} within {self._attempt_s:g} s"))

    def close(self) -> Ended:
        """Send DISCONNECT if the connection lives, close it, and return how it ended."""
        if self.ended is None:
            self.ended = Ended(Ending.STOPPED, "stopped")
            self._wire.disconnect()
        if self._wire.socket is not None:
            self._wire.socket.close()
        os.close(self._wake)
        return self.ended

    # --- the inside -------------------------------------------------------------------------

    def _wait(self, sock: Any, timeout_s: float) -> tuple[bool, bool]:
        # A flood that is not read from the socket waits at its sender, so our memory stays bounded.
        swamped = self._backlog() > _MOST_BACKLOG
        # Bytes that TLS has already decrypted do not make the socket readable.
        pending = not swamped and isinstance(sock, ssl.SSLSocket) and sock.pending() > 0
        readable, writable, _ = select.select(
            [self._wake] if swamped else [sock, self._wake],
            [sock] if self._wire.wants_to_write else [],
            [],
            0.0 if pending else min(timeout_s, _SWAMPED_S) if swamped else timeout_s,
        )
        if self._wake in readable:
            os.eventfd_read(self._wake)
        return pending or sock in readable, sock in writable

    def _offer(self, deed: Offer | Callable[[], object]) -> None:
        self._outgoing.append(deed)
        self.wake()

    def _hand_over(self) -> None:
        while self._outgoing and self._sending.has_room:
            deed = self._outgoing.popleft()
            if isinstance(deed, Offer):
                self._sending.publish(deed)
            else:
                deed()

    def _end(self, ended: Ended) -> None:
        if self.ended is None:  # the first end is the cause; the others follow from it
            self.ended = ended

    def _acknowledged(self, token: int) -> None:
        self._emit(Acknowledged(token))

    # --- subscriptions ------------------------------------------------------------------------

    def _ask(self, subscriptions: Sequence[Subscription], done: Callable[[Refused], None]) -> None:
        most = min(self.limits.qos, self._command_qos)
        self._asking.ask([replace(one, qos=min(one.qos, most)) for one in subscriptions], done)

    def _asked(self, refused: Refused) -> None:
        """Handle the answers to our first subscriptions."""
        codes = {answer.code for answer in refused.values()}
        if refusals.NO_WILDCARDS in codes and self._memory.wildcards:
            self._memory.wildcards = False  # CONNACK did not say it
            self._ask_plain(self._asked)
            return
        self.denied = {topic: answer.told for topic, answer in refused.items()}
        self.ready = True

    def _ask_plain(self, done: Callable[[Refused], None]) -> None:
        self.limits = replace(self.limits, wildcards=False)
        plain = self._plain()
        self._plainly_asked.update(plain)
        self._ask(plain, done)

    def _ask_besides(self, subscriptions: Sequence[Subscription]) -> None:
        allowed = [one for one in subscriptions if self._is_allowed(one.topic_filter)]
        denied = [one.topic_filter for one in subscriptions if one not in allowed]
        if not self.limits.wildcards:
            # The reading of retained messages also follows a reload.
            allowed += [one for one in self._plain() if one not in self._plainly_asked]
            self._plainly_asked.update(allowed)
        self._ask(allowed, lambda refused: self._emit(Subscribed((*denied, *refused))))

    def _unsubscribe(self, topic_filters: Sequence[str]) -> None:
        allowed = [one for one in topic_filters if self._is_allowed(one)]
        for at in range(0, len(allowed), self._memory.filters):
            self._wire.unsubscribe(allowed[at : at + self._memory.filters])

    def _is_allowed(self, topic_filter: str) -> bool:
        return self.limits.wildcards or not set("+#") & set(topic_filter)

    # --- what the wire tells, in the owner's thread -------------------------------------------

    def connected(self, answer: Answer, limits: BrokerLimits) -> None:
        """Handle the broker's answer to CONNECT."""
        if answer.is_failure:
            self._memory.refused(answer.code)
            self._end(closing.refused(answer))
            return
        self._answered = True
        self.subscribed_at = boot_s()
        self.limits = limits
        self._sending.limit(limits)
        if limits.wildcards and self._memory.wildcards:
            self._ask(self._subscriptions, self._asked)
        else:
            self._ask_plain(self._asked)

    def subscribed(self, _message_id: int, answers: Sequence[Answer]) -> None:
        """Handle the broker's answer to SUBSCRIBE, filter by filter."""
        self._ready_by = boot_s() + self._attempt_s
        self._asking.answered(answers)

    def published(self, message_id: int, answer: Answer) -> None:
        """Record that a message is written (QoS 0) or answered."""
        self._sending.published(message_id, answer)

    def arrived(self, message: Received | None, cut_bytes: int) -> None:
        """Handle an arrived message; None: its topic is not UTF-8."""
        if message is None:
            self._counters.undecodable_topics += 1
            text = "dropped a message: its topic is not UTF-8"
            self._log.tell(Cause.MESSAGE, "topic", logging.WARNING, text)
            return
        if cut_bytes:
            line = (
                f"a message of {cut_bytes} bytes on {message.topic[:_TOPIC_CHARS]!r} was not read"
            )
            most = f"at most {MOST_PACKET_BYTES} are"
            self._log.tell(Cause.MESSAGE, "in", logging.WARNING, f"{line}: {most}")
        self._emit(message)

    def closed(self, answer: Answer, error: str | None, *, by_broker: bool) -> None:
        """Record that the connection ended: by DISCONNECT, by an error, or silently."""
        said = closing.said_of(answer) if by_broker else error
        if by_broker and answer.code == refusals.SESSION_TAKEN_OVER:
            self._end(Ended(Ending.TAKEN_OVER, str(said)))
        elif not self._answered:
            self._end(closing.closed_at_connect(error))
        elif not self.ready:
            asked = self._memory.filters
            self._memory.closed_at_subscribe()
            self._end(closing.closed_at_subscribe(said, asked, self._memory.filters))
        elif (blamed := self._sending.blame(answer)) is not None:
            self._end(closing.closed_over(blamed, said))
        else:
            self._end(closing.closed(answer, error, by_broker=by_broker))
