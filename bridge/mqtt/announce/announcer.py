"""Announces the devices to Home Assistant in steps, and clears what is no longer configured."""

import logging
import time
from collections import deque
from collections.abc import Callable, Sequence

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.config.current import CurrentConfig
from bridge.config.schema import Config
from bridge.mqtt.announce.count_topics import CountTopics, FoundCounts
from bridge.mqtt.announce.discovery import discovery_messages
from bridge.mqtt.announce.leftovers import Leftovers
from bridge.mqtt.announce.migration import Announcement, Batch, DiscoveryTopics, announce
from bridge.mqtt.announce.survey import Survey
from bridge.mqtt.events import OutMessage, Received, Subscription
from bridge.mqtt.outbox import Outbox
from bridge.mqtt.payloads import CLEARED

_log = logging.getLogger(__name__)

# Home Assistant needs time to unload an entity, and ignores messages for it meanwhile.
STEP_S = 2.0
_NAMED_TOPICS = 5  # in the log; the rest is counted

Cleared = Callable[[list[str]], None]


class Announcer:
    """Reads what the broker retains of ours, then announces, at each connect.

    `subscribe` and `unsubscribe` are used only for this reading. `found_counts` is called with the
    retained counts after each reading. Only the main thread calls it.
    """

    def __init__(
        self,
        current: CurrentConfig,
        outbox: Outbox,
        subscribe: Callable[[Sequence[Subscription]], None],
        unsubscribe: Callable[[Sequence[str]], None],
        found_counts: FoundCounts,
        *,
        budgets: Budgets | None = None,
    ) -> None:
        """Create it; `budgets` limit its log lines."""
        self._bounded = BoundedLog(_log, time.monotonic, budgets)
        self._outbox = outbox
        self._subscribe = subscribe
        self._unsubscribe = unsubscribe
        self._current = current
        self._protocol = "5"  # of the connection, or of the last one
        self._configs: Sequence[OutMessage] = ()  # while the survey lasts: they are long
        self._device_topics: Sequence[str] = ()  # none before the first connection
        self._follow(current.config)
        self._found_counts = found_counts
        self._connected = False
        self._announced: Callable[[], None] | None = None
        self._survey: Survey | None = None
        self._looked_at: list[str] = []
        self._steps: deque[tuple[Batch, bool]] = deque()  # and whether it announces all devices
        self._step_at = 0.0
        self._touched: set[str] = set()  # discovery topics that the outbox was given
        self._retired: set[str] = set()  # states of an earlier configuration of this run
        self._purges: list[Cleared] = []

    # --- what the session tells -----------------------------------------------------------------

    def connected(self, now: float, protocol: str, announced: Callable[[], None]) -> None:
        """Begin with a new connection, which uses MQTT "5" or "3.1.1".

        `announced` is called when all devices were announced over it.
        """
        self.disconnected()
        self._protocol = protocol
        self._connected = True
        self._announced = announced
        self._look(now)

    def disconnected(self) -> None:
        """End with the connection: over the next one everything is done again."""
        self._connected = False
        self._survey = None
        self._configs = ()
        self._steps.clear()
        self._purges.clear()
        # Else it would be sent at the next connect, before the retained messages are read.
        self._outbox.forget(self._touched)
        self._touched.clear()

    def answered(self, now: float) -> None:
        """Record that the broker answered the subscription: denied topics are simply not seen."""
        if self._survey is not None:
            self._survey.answered(now)

    def receive(self, received: Received, now: float) -> None:
        """Handle a message that belongs to no other part."""
        if self._survey is not None:
            self._survey.receive(received, now)

    def tick(self, now: float) -> None:
        """Do what is due."""
        survey = self._survey
        if survey is not None and survey.is_over(now):
            self._survey = None
            self._unsubscribe(self._looked_at)
            self._found_counts(self._counts.among(survey.retained))
            self._conclude(survey, now)
        if self._steps and now >= self._step_at:
            self._step_at = now + STEP_S
            batch, announces_all = self._steps.popleft()
            self._send(batch, now)
            if announces_all and self._announced is not None:
                self._announced()

    def again(self) -> None:
        """Announce every device again: Home Assistant was started."""
        self._outbox.again(self._device_topics)

    # --- what others ask for --------------------------------------------------------------------

    def config_replaced(self, retired: set[str], now: float) -> None:
        """Announce what the configuration is now; clear the states on `retired` topics."""
        self._retired |= retired
        if self._connected:
            self._look(now)

    def purge(self, cleared: Cleared, now: float) -> None:
        """Clear leftovers now; call `cleared` with the topics."""
        self._purges.append(cleared)
        if self._survey is None:
            self._look(now)

    # --- the inside -----------------------------------------------------------------------------

    def _follow(self, config: Config) -> None:
        self._leftovers = Leftovers(config)
        self._topics = DiscoveryTopics(config)
        self._counts = CountTopics(config)

    def _look(self, now: float) -> None:
        config = self._current.config
        self._follow(config)
        self._configs = discovery_messages(config, self._protocol)
        self._device_topics = [message.topic for message in self._configs]
        if self._survey is not None:
            self._unsubscribe(self._looked_at)
        self._steps.clear()  # they are planned again from the retained messages
        ours = {message.topic: message.payload for message in self._configs}
        self._survey = Survey(self._concerns, ours, now)
        subscriptions = [*self._leftovers.subscriptions(), *self._topics.subscriptions()]
        self._looked_at = [one.topic_filter for one in subscriptions]
        self._subscribe(subscriptions)

    def _concerns(self, topic: str) -> bool:
        return (
            self._leftovers.concerns(topic)
            or self._topics.parse(topic) is not None
            or topic in self._counts
        )

    def _conclude(self, survey: Survey, now: float) -> None:
        known = {topic: self._outbox.latest(topic) for topic in self._touched}
        # An access list may keep us from reading what we wrote.
        told = {topic: payload for topic, payload in known.items() if payload}
        orphans = [topic for topic in told if self._topics.parse(topic) is None]
        plan = announce(self._configs, {**told, **survey.retained}, self._topics)
        self._configs = ()
        states = [*self._left_over(survey), *orphans]
        self._schedule(plan, states, now)
        cleared = [*plan.cleared, *states]
        self._tell(cleared)
        for purge in self._purges:
            purge(cleared)
        self._purges.clear()

    def _left_over(self, survey: Survey) -> list[str]:
        # An incomplete survey does not show whether another bridge has its topics below ours.
        found = self._leftovers.among(survey.retained) if survey.is_whole else []
        # A topic that a later configuration has again is not retired any more.
        stray = {topic for topic in self._retired if self._leftovers.concerns(topic)}
        self._retired = {topic for topic in stray if self._outbox.latest(topic)}
        return sorted(self._retired.union(found))

    def _schedule(self, plan: Announcement, leftovers: Sequence[str], now: float) -> None:
        # States last: an entity that still exists would fail on an empty state.
        states = tuple(OutMessage(topic, CLEARED, qos=1, retain=True) for topic in leftovers)
        self._steps.extend((batch, False) for batch in plan.before)
        self._steps.append((plan.configs, True))
        self._steps.extend((batch, False) for batch in (plan.after, states) if batch)
        self._step_at = now

    def _send(self, batch: Batch, now: float) -> None:
        for message in batch:
            if self._topics.parse(message.topic) is not None:
                self._touched.add(message.topic)
            self._outbox.put(message, now)

    def _tell(self, cleared: Sequence[str]) -> None:
        if not cleared:
            return
        named = ", ".join(cleared[:_NAMED_TOPICS])
        more = len(cleared) - _NAMED_TOPICS
        rest = f" and {more} more" if more > 0 else ""
        text = f"cleared what is not configured any more: {named}{rest}"
        self._bounded.tell(Cause.LEFTOVERS, "", logging.INFO, text)
