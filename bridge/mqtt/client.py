"""The MQTT client: one supervised thread that opens one `Connection` after the other."""

import logging
import threading
from collections.abc import Callable, Sequence

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.clock import boot_s
from bridge.config.schema import MqttConfig
from bridge.mqtt.broker_limits import BrokerLimits
from bridge.mqtt.broker_memory import BrokerMemory
from bridge.mqtt.connection import Connection
from bridge.mqtt.counters import Counters
from bridge.mqtt.events import Connected, Disconnected, MqttEvent, OutMessage, Subscription
from bridge.mqtt.reconnect import Backoff, Ended, Ending, ReconnectPlan, explain
from bridge.mqtt.servers import Candidate, ServerTurn
from bridge.mqtt.wire import accepts

_log = logging.getLogger(__name__)

_LOOK_S = 0.5  # how often a waiting thread gives a sign of life and looks at `stop`
_CONNECTING_S = 60.0  # name lookup and connecting to each address have deadlines of their own
_CONNECTING_STOP_S = 1.0  # a blocking connect cannot be interrupted: its thread is left behind


class MqttClient:
    """Connects, reports events and publishes. `emit` is called in the thread of the client.

    While `backlog` is over 16,384 unhandled events, nothing is read: a flood then waits at its
    sender, not in our memory.

    Attributes:
        failure: Why the thread died, or None.
        progress: The last sign of life of the thread (`bridge.clock.boot_s`). It lies in the future
            while the thread connects: a name lookup without a network takes longer than a watchdog
            waits.
        counters: The number of faults since the start.
        trouble: Why there is no connection, in words for the log; None: there is one.
        rejected: The broker refuses our username and password.
        asks_for_less: It takes fewer filters at once, as it seems: the next try asks for fewer.
    """

    def __init__(
        self,
        config: MqttConfig,
        subscriptions: Sequence[Subscription],
        emit: Callable[[MqttEvent], None],
        will: OutMessage | None,
        *,
        backoff: Backoff | None = None,
        backlog: Callable[[], int] = lambda: 0,
        plain: Callable[[], Sequence[Subscription]] = tuple,
        budgets: Budgets | None = None,
    ) -> None:
        """Create it; `plain` returns subscriptions without wildcards; `budgets` limit its log."""
        self.failure: str | None = None
        self.progress = boot_s()
        self.counters = Counters()
        self.trouble: str | None = None
        self.rejected = False
        self.asks_for_less = False
        self._config = config
        self._subscriptions = tuple(subscriptions)
        self._emit = emit
        self._will = will
        self._bounded = BoundedLog(_log, boot_s, budgets)
        self._backlog = backlog
        self._plain = plain
        self._memory = BrokerMemory()
        self._restrictions: set[str] = set()
        self._backoff = backoff or Backoff()
        self._plan = ReconnectPlan(config.protocol, self._backoff, is_cluster=bool(config.others))
        self._turn = ServerTurn(config.servers)
        self._candidate = Candidate(config.servers[0], None)
        self._ready_since = 0.0
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)
        self._stopping = threading.Event()
        self._stop_by = 0.0
        self._lock = threading.Lock()  # for `_connection` and `_token`, held for moments
        self._connection: Connection | None = None
        self._token = 0

    def start(self) -> None:
        """Start the thread; return at once, also without a broker."""
        self._thread.start()

    def stop(self, timeout_s: float) -> None:
        """Wait up to `timeout_s` until published messages are acknowledged; send DISCONNECT."""
        connected = self.connected
        with self._lock:
            self._stop_by = boot_s() + timeout_s
            self._stopping.set()
            if self._connection is not None:
                self._connection.wake()
        if self._thread.is_alive():
            self._thread.join(timeout_s + 2 * _LOOK_S if connected else _CONNECTING_STOP_S)

    def publish(self, message: OutMessage) -> int | None:
        """Queue a message, in any thread; never blocks, never raises.

        Returns:
            The token that `Acknowledged` repeats (QoS 1), or None: not connected.
        """
        with self._lock:
            if self._connection is None or not self._connection.usable:
                return None
            self._token += 1
            self._connection.offer(self._token, message)
            if _log.isEnabledFor(logging.DEBUG):
                _log.debug("sent %s: %.256r", message.topic, message.payload)
            return self._token

    def leave_mute(self) -> None:
        """Try another server, where there is one: no ping comes back from this one.

        Any thread may call it; it never blocks.
        """
        with self._lock:
            if self._connection is None or not self._connection.usable:
                return
            was_good = boot_s() - self._ready_since > self._backoff.lasting_s
            if self._turn.leave(self._candidate, was_good=was_good):
                why = "no ping comes back: another server is tried"
                self._connection.leave(Ended(Ending.LEFT, why))

    def connect_anew(self, why: str) -> None:
        """End this connection, because it is no good, and make another.

        Any thread may call it; it never blocks.
        """
        with self._lock:
            if self._connection is not None and self._connection.usable:
                self._connection.leave(Ended(Ending.LOST, why))

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """Add subscriptions to this connection; `Subscribed` answers. Without one do nothing."""
        with self._lock:
            if self._connection is not None and self._connection.usable:
                self._connection.subscribe(subscriptions)

    def unsubscribe(self, topic_filters: Sequence[str]) -> None:
        """Remove subscriptions that `subscribe` added."""
        with self._lock:
            if self._connection is not None and self._connection.usable:
                self._connection.unsubscribe(topic_filters)

    @property
    def connected(self) -> bool:
        """Return whether the broker accepted us and answered the subscriptions."""
        with self._lock:
            return self._connection is not None and self._connection.usable

    def alive(self) -> bool:
        """Return whether the thread runs; `failure` says why not."""
        return self._thread.is_alive()

    # --- the thread -------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._pause(self._live_through_one())
        except Exception as error:  # noqa: BLE001  # the end of a thread says its cause
            self.failure = f"{type(error).__name__}: {error}"
            _log.exception("the MQTT thread died")

    def _live_through_one(self) -> float:
        """Open one connection, serve it until it ends; return the pause that follows."""
        self._sign_of_life(ahead_s=_CONNECTING_S)
        if not self._plan.tries_other:
            self._candidate = self._turn.next()
        candidate = self._candidate
        connection = Connection(
            self._config.at(candidate.server),
            address=candidate.address,
            protocol=self._plan.protocol,
            subscriptions=self._subscriptions,
            plain=self._plain,
            will=self._will,
            emit=self._emit,
            counters=self.counters,
            memory=self._memory,
            attempt_s=self._backoff.attempt_s,
            backlog=self._backlog,
            log=self._bounded,
        )
        began = boot_s()
        with self._lock:
            self._connection = connection
        try:
            self._serve(connection)
        finally:
            with self._lock:
                self._connection = None
            ended = connection.close()
        if connection.ready:
            self._emit(Disconnected(ended.cause, boot_s()))
        return self._after(ended, boot_s() - began)

    def _serve(self, connection: Connection) -> None:
        self._sign_of_life(ahead_s=_CONNECTING_S)
        connection.open()
        announced = False
        while connection.ended is None and not self._may_stop(connection):
            self._sign_of_life()
            connection.step(_LOOK_S)
            if connection.ready and not announced:
                announced = True
                self._announce(connection)

    def _may_stop(self, connection: Connection) -> bool:
        if not self._stopping.is_set():
            return False
        return not connection.ready or connection.idle or boot_s() >= self._stop_by

    def _announce(self, connection: Connection) -> None:
        protocol = self._plan.protocol
        self._plan.connected()
        with self._lock:  # `leave_mute` asks for both
            self._turn.worked(self._candidate)
            self._ready_since = boot_s()
        self.trouble = None
        self.rejected = self.asks_for_less = False
        self.counters.connections += 1
        where = str(self._candidate.server)
        text = f"connected to the broker at {where} with MQTT {protocol}"
        self._bounded.end(Cause.BROKER_CONNECTION, "", text, always=True)
        self._tell_denied(connection.denied, where)
        self._tell_restrictions(connection.limits)
        self._emit(Connected(protocol, connection.subscribed_at))

    def _tell_denied(self, denied: dict[str, str], where: str) -> None:
        for topic_filter in (one.topic_filter for one in self._subscriptions):
            if topic_filter in denied:
                text = f"the broker denies the subscription to {topic_filter}: "
                text += denied[topic_filter]
                level = logging.WARNING
                self._bounded.tell(Cause.BROKER_DENIES, topic_filter, level, text, once=True)
            else:
                text = f"the broker at {where} grants the subscription to {topic_filter} again"
                self._bounded.end(Cause.BROKER_DENIES, topic_filter, text)

    def _tell_restrictions(self, limits: BrokerLimits) -> None:
        for name, line in limits.restrictions():
            if name not in self._restrictions:
                self._restrictions.add(name)
                self._bounded.tell(Cause.BROKER_DENIES, name, logging.WARNING, line, once=True)

    def _after(self, ended: Ended, lasted_s: float) -> float:
        ended = self._plan.judge(self._examined(ended), lasted_s)
        has_more = self._turn.has_more
        pause_s = self._plan.pause_after(ended.ending, lasted_s, has_more=has_more)
        self.counters.taken_over += ended.ending is Ending.TAKEN_OVER
        line = explain(ended, self._config.at(self._candidate.server), pause_s)
        if pause_s > 0 and self._config.others:
            line += f" (the last of {len(self._config.servers)} servers)"
        # One line for each change: a stop, or a step to the other protocol, is none.
        told = pause_s > 0 or ended.ending is Ending.LEFT
        if told and ended.ending is not Ending.STOPPED and line != self.trouble:
            self.trouble = line
            self.rejected = ended.ending is Ending.CREDENTIALS
            self.asks_for_less = ended.ending is Ending.NOT_SUBSCRIBED
            self._bounded.tell(Cause.BROKER_CONNECTION, "", logging.WARNING, line)
        return pause_s

    def _examined(self, ended: Ended) -> Ended:
        # A broker that stops also closes connections, but then it does not listen any more.
        if ended.ending is not Ending.HUNG_UP:
            return ended
        self._sign_of_life(ahead_s=_CONNECTING_S)
        server, address = self._candidate.server, self._candidate.address
        if accepts(address or server.host, server.port, self._backoff.attempt_s):
            return ended
        return Ended(Ending.LOST, "it stopped")

    def _pause(self, pause_s: float) -> None:
        until = boot_s() + pause_s
        while (rest_s := until - boot_s()) > 0:
            self._sign_of_life()
            if self._stopping.wait(min(rest_s, _LOOK_S)):
                return

    def _sign_of_life(self, ahead_s: float = 0.0) -> None:
        self.progress = boot_s() + ahead_s
        self._bounded.tick()
