"""The conversation with the broker: the reaction to each event, and what is due by time."""

import logging
import math
import queue
import time
from collections.abc import Callable
from typing import assert_never

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.config.schema import Config
from bridge.mqtt import payloads
from bridge.mqtt.access import CommandProbe
from bridge.mqtt.announce.announcer import Announcer
from bridge.mqtt.events import (
    Acknowledged,
    Connected,
    Disconnected,
    MqttEvent,
    OutMessage,
    Received,
    Subscribed,
)
from bridge.mqtt.intake import CommandIntake
from bridge.mqtt.link import STALE_AFTER_S, LinkCheck
from bridge.mqtt.log_handler import LogLine
from bridge.mqtt.outbox import Outbox, Send
from bridge.mqtt.publisher import MqttPublisher
from bridge.mqtt.requests import RequestDesk
from bridge.mqtt.topics import (
    CommandTarget,
    CoverTarget,
    OwnTopic,
    RequestTarget,
    RuleTarget,
    Topics,
)

_log = logging.getLogger(__name__)

_REASSERT_EVERY_S = 1.0
_LOG_LINES_A_TICK = 10
_LEAVE_AFTER_S, _LEAVE_EVERY_S = 7.0, 60.0  # after the 3 s in which no ping came back
# A broker answers in order; one that keeps copies on other nodes answers a ping sooner.
_ANSWER_WITHIN_S = 30.0


class Session:
    """Handles the events of the client, and what is due by time.

    The main loop calls `handle` for each event and `tick` at the end of every round, at least every
    0.25 s: then the outbox is sent.
    """

    def __init__(
        self,
        *,
        topics: Topics,
        status_topic: str,
        outbox: Outbox,
        publisher: MqttPublisher,
        link: LinkCheck,
        access: CommandProbe,
        intake: CommandIntake,
        desk: RequestDesk,
        announcer: Announcer,
        log_lines: queue.Queue[LogLine],
        publish: Send,
        jitter_s: Callable[[], float],
        leave_mute: Callable[[], None],
        connect_anew: Callable[[str], None],
        all_sent: Callable[[], None],
        repeat_s: float | None,
        budgets: Budgets | None = None,
    ) -> None:
        """Args: `jitter_s` draws from 0-2 s; `budgets` are those of the log.

        `leave_mute` tries another server of the cluster, because no ping comes back. `all_sent` is
        called after a connect, when everything is sent. All states are published again every
        `repeat_s`.
        """
        self._bounded = BoundedLog(_log, time.monotonic, budgets)
        self._topics = topics
        self._status_topic = status_topic
        self._outbox = outbox
        self._publisher = publisher
        self._link = link
        self._access = access
        self._intake = intake
        self._desk = desk
        self._announcer = announcer
        self._log_lines = log_lines
        self._publish = publish
        self._jitter_s = jitter_s
        self._leave_mute = leave_mute
        self._connect_anew = connect_anew
        self._all_sent = all_sent
        self._is_burst = False  # since `online` of this connection, until everything is sent
        self._repeat_s = math.inf if repeat_s is None else repeat_s
        self._repeat_at = math.inf
        self._leave_at = 0.0
        self._connected = False
        self._protocol = ""  # of the connection, or of the last one
        self._stopped = False
        self._mute = False
        self._dropped_verdicts = 0
        self._is_all_told = False
        self._refresh_at: float | None = None
        self._reassert_at: float | None = None
        self._reasserted_at: float | None = None

    @property
    def drained(self) -> bool:
        """Return whether the broker has everything that could be sent."""
        return self._outbox.idle

    def is_away(self, now: float) -> bool:
        """Return whether the broker is away: this ends when a ping comes back (F6)."""
        return self._link.away(now)

    def suspended(self, slept_s: float, now: float) -> None:
        """Require a new proof of the link after a suspend of the machine."""
        text = f"the machine was suspended for {slept_s:.0f} s: older commands are refused"
        self._bounded.tell(Cause.CLOCK, "", logging.WARNING, text)
        self._link.suspended(now)

    def stopping(self) -> None:
        """Refuse commands from now on."""
        self._intake.stopping = True

    def stop(self, now: float) -> None:
        """Publish that everything is offline. The caller continues `tick` until `drained`."""
        self.stopping()
        self._stopped = True
        self._refresh_at = self._reassert_at = None
        self._outbox.end_repeats()
        self._publisher.all_offline()
        self.tick(now)

    def config_replaced(self, before: Config, now: float) -> None:
        """Go on after a reload from `before` at the same broker."""
        retired = self._publisher.config_replaced(before)
        if self._connected:
            self._publisher.bridge_info(self._protocol)
        self._announcer.config_replaced(retired, now)

    def handle(self, event: MqttEvent, now: float) -> None:
        """Handle one event of the client, in the order of arrival."""
        match event:
            case Received():
                self._received(event, now)
            case Acknowledged(token):
                self._outbox.acknowledged(token)
            case Connected(protocol, at):
                self._begin(protocol, at, now)
            case Disconnected():
                self._end(now)
            case Subscribed():
                self._announcer.answered(now)
            case _:
                assert_never(event)

    def tick(self, now: float) -> None:
        """Do what is due, and send what waits."""
        if self._connected:
            self._publisher.follow_wall_clock()
            self._ping(now)
            self._refresh(now)
            self._repeat(now)
            self._reassert(now)
            self._tell_link(now)
            self._renew()
            self._tell_access(now)
            self._announcer.tick(now)
            self._tell_online(now)
        self._bounded.tick()
        self._tell_log()
        self._outbox.pump(self._publish, now)
        if self._is_burst and self._outbox.idle:
            self._is_burst = False
            self._all_sent()

    # --- events -------------------------------------------------------------------------------

    def _received(self, received: Received, now: float) -> None:
        if _log.isEnabledFor(logging.DEBUG):
            _log.debug("taken %s: %.256r", received.topic, received.payload)
        if received.topic == self._status_topic:
            if received.payload == payloads.ONLINE and self._refresh_at is None:
                # All bridges of a house receive this birth message, so they answer at different
                # times.
                self._refresh_at = now + self._jitter_s()
            return
        if self._access.took(received.topic, received.payload):
            return
        match self._topics.parse(received.topic):
            case CommandTarget() | CoverTarget() | RuleTarget() as target:
                self._intake.receive(target, received, now)
            case RequestTarget(verb):
                self._desk.receive(verb, received)
            case OwnTopic.PING:
                self._link.seen(received.payload, received.at)
            case OwnTopic.STATE if received.payload == payloads.OFFLINE:
                self._contradict(now)
            case None:
                self._announcer.receive(received, now)

    def _begin(self, protocol: str, at: float, now: float) -> None:
        """Send everything again, in the order of docs/contract.md: `bridge/state` is the last."""
        self._connected = True
        self._protocol = protocol
        self._repeat_at = now + self._repeat_s
        self._link.connected(at)
        self._access.connected(now)
        self._ping(now)  # before the burst: it proves the link, which `online` waits for
        self._publisher.assume_offline()
        self._publisher.bridge_info(protocol)
        self._outbox.forget([self._topics.bridge_state])
        self._outbox.connected([*self._publisher.order(), self._topics.bridge_info], now)
        self._announcer.connected(now, protocol, self._all_told)
        self._tell_dropped()

    def _all_told(self) -> None:
        """Remember that states and devices are published: `online` may follow."""
        self._is_all_told = True

    def _tell_online(self, now: float) -> None:
        """Publish `online` last, once commands are accepted: automations react with commands."""
        if self._is_all_told and (not self._link.stale(now) or self._link.mute(now)):
            self._is_all_told = False
            self._publisher.bridge_state(not self._stopped)
            self._is_burst = True

    def _end(self, now: float) -> None:
        self._connected = False
        self._mute = self._is_all_told = self._is_burst = False
        self._refresh_at = self._reassert_at = None
        self._link.disconnected()
        self._announcer.disconnected()
        self._outbox.disconnected(now)

    def _contradict(self, now: float) -> None:
        """Publish `online` again: a late last will of an earlier connection said `offline`."""
        if self._stopped or self._reassert_at is not None:
            return
        last = self._reasserted_at
        self._reassert_at = now if last is None else max(now, last + _REASSERT_EVERY_S)

    # --- what falls due -----------------------------------------------------------------------

    def _ping(self, now: float) -> None:
        payload = self._link.ping(now)
        if payload is not None:
            # Not through the outbox: a ping that waits in our own queue would measure the wrong
            # thing.
            self._publish(OutMessage(self._topics.ping, payload, qos=0, retain=False))
        for probe in self._access.due(now):
            self._publish(probe)

    def _refresh(self, now: float) -> None:
        """Publish devices and then all values again: Home Assistant was started."""
        # A birth message meanwhile starts one more round after this one.
        if self._refresh_at is None or now < self._refresh_at or self._outbox.repeating:
            return
        self._refresh_at = None
        self._announcer.again()
        self._outbox.again([*self._publisher.order(), self._topics.bridge_state])

    def _repeat(self, now: float) -> None:
        """Publish all states again: a cluster loses messages between nodes that are cut off."""
        if now < self._repeat_at or self._stopped or self._outbox.repeating:
            return
        self._repeat_at = now + self._repeat_s
        self._outbox.again([*self._publisher.repeated(), self._topics.bridge_state])

    def _reassert(self, now: float) -> None:
        if self._reassert_at is None or now < self._reassert_at:
            return
        self._reassert_at = None
        self._reasserted_at = now
        self._outbox.repeat_now(self._topics.bridge_state)

    def _tell_link(self, now: float) -> None:
        mute = self._link.mute(now)
        if mute and not self._mute:
            text = (
                f"no ping came back on {self._topics.ping} for {STALE_AFTER_S:.0f} s: commands are "
                "refused meanwhile. The broker is slow, or it does not let us publish or "
                "subscribe there"
            )
            self._bounded.tell(Cause.BROKER_STALE, "", logging.WARNING, text)
        elif self._mute and not mute:
            text = "pings come back again: commands are taken"
            self._bounded.end(Cause.BROKER_STALE, "", text)
        self._mute = mute
        if not mute:
            self._leave_at = now + _LEAVE_AFTER_S
        elif now >= self._leave_at:
            self._leave_at = now + _LEAVE_EVERY_S
            self._leave_mute()

    def _renew(self) -> None:
        """Connect anew if the broker lost acknowledgements: the window would stay closed.

        Mosquitto drops them when too many messages wait for a client (docs/fleet.md).
        """
        since = self._outbox.unacknowledged_since
        if since is not None and self._link.answered_since(since + _ANSWER_WITHIN_S):
            self._connect_anew("it answered a later ping, and not a message before it")

    def _tell_access(self, now: float) -> None:
        for topic, topic_filter in () if self._mute else self._access.newly_lost(now):
            text = (
                f"what we publish on {topic} does not come back, so commands on {topic_filter} may "
                "never reach us: check the access list of the broker"
            )
            self._bounded.tell(Cause.BROKER_DENIES, topic_filter, logging.WARNING, text)

    def _tell_log(self) -> None:
        for _ in range(_LOG_LINES_A_TICK):
            try:
                line = self._log_lines.get_nowait()
            except queue.Empty:
                return
            self._publisher.log(line)

    def _tell_dropped(self) -> None:
        dropped = self._outbox.dropped_verdicts
        if dropped > self._dropped_verdicts:
            lost = dropped - self._dropped_verdicts
            text = "{amount} verdicts were dropped while the broker was away"
            self._bounded.tell(Cause.VERDICTS, "", logging.WARNING, text, amount=lost)
        self._dropped_verdicts = dropped
