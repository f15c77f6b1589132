"""Builds the tree of the main thread's objects. Tests build it with the same function.

What a test has in place of the real thing is an argument: workers, the client, clocks, chance.
"""

import os
import queue
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Protocol

from bridge.bounded_log import Budgets
from bridge.config.current import CurrentConfig
from bridge.config.schema import Config, LineConfig
from bridge.daemon.bridge_requests import Services
from bridge.daemon.heap import trim_heap
from bridge.daemon.line_requests import ErrandDesk
from bridge.daemon.reload import Reload
from bridge.daemon.systemd import Notifier
from bridge.daemon.trace import TraceDesk
from bridge.hub.count_keeper import CountKeeper
from bridge.hub.counts import Counts
from bridge.hub.hub import Hub
from bridge.hub.line_set import LineSet, Worker
from bridge.hub.memory import Memory
from bridge.hub.rule_keeper import RuleKeeper
from bridge.line.errand import ErrandTold
from bridge.model import AnyCommand, LinePassed, PublicEvent, Publish
from bridge.mqtt.access import CommandProbe
from bridge.mqtt.announce.announcer import Announcer
from bridge.mqtt.announce.count_topics import FoundCounts
from bridge.mqtt.events import OutMessage, Subscription
from bridge.mqtt.intake import CommandIntake, SwitchRule
from bridge.mqtt.link import LinkCheck
from bridge.mqtt.log_handler import LogLine
from bridge.mqtt.outbox import Outbox
from bridge.mqtt.publisher import MqttPublisher
from bridge.mqtt.requests import RequestDesk
from bridge.mqtt.session import Session
from bridge.mqtt.topics import Topics
from bridge.transport.bus import Bus, bus_of
from bridge.transport.opener import open_port
from bridge.transport.port import Port

_BIRTH_JITTER_S = 2.0

OpenPort = Callable[[str, int], Port]


def open_bus(line: LineConfig, open_port: OpenPort = open_port) -> Bus:
    """Open the port of a line. Raises PortError."""
    port = open_port(line.port, line.baud)
    bus = bus_of(line, port)
    bus.await_silence()
    return bus


def wall_clock() -> datetime:
    """Return what the clock on the wall shows, with its zone."""
    return datetime.now().astimezone()


def _birth_jitter_s() -> float:
    return random.uniform(0, _BIRTH_JITTER_S)  # noqa: S311  # no secret


class BrokerClient(Protocol):
    """Describe what the tree needs of the MQTT client (`bridge.mqtt.client`)."""

    def publish(self, message: OutMessage) -> int | None:
        """Hand over a message; return its token, or None without a connection."""

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """Ask for more until the connection ends."""

    def unsubscribe(self, topic_filters: Sequence[str]) -> None:
        """Remove subscriptions that `subscribe` added."""

    def leave_mute(self) -> None:
        """Try another server of the cluster, because no ping comes back."""

    def connect_anew(self, why: str) -> None:
        """End this connection, because it is no good, and make another."""


@dataclass(frozen=True, slots=True)
class Outside:
    """What the tree stands on: real in the bridge, a test's own in a test.

    Attributes:
        client: The way to the broker.
        clock: As `bridge.clock.boot_s`.
        wall_clock: As `wall_clock` here.
        log_lines: Log lines that wait to be published.
        jitter_s: Draws how long the answer to a birth of Home Assistant waits.
        nonce: What tells the pings and probes of this run from those of other bridges.
        budgets: Those of the log.
    """

    client: BrokerClient
    clock: Callable[[], float]
    wall_clock: Callable[[], datetime] = wall_clock
    log_lines: queue.Queue[LogLine] = field(default_factory=queue.Queue)
    jitter_s: Callable[[], float] = _birth_jitter_s
    nonce: str = field(default_factory=lambda: os.urandom(4).hex())
    budgets: Budgets | None = None


@dataclass(frozen=True, slots=True)
class BrokerSide:
    """Everything that stands between the hub and the MQTT client."""

    topics: Topics
    outbox: Outbox
    link: LinkCheck
    publisher: MqttPublisher
    publish: Publish
    announcer: Announcer
    desk: RequestDesk
    intake: CommandIntake
    session: Session


@dataclass(frozen=True, slots=True)
class Tree:
    """The objects of the main thread."""

    current: CurrentConfig
    broker: BrokerSide
    lines: LineSet
    counts: Counts
    count_keeper: CountKeeper
    rule_keeper: RuleKeeper
    hub: Hub
    reload: Reload
    errands: ErrandDesk
    traces: TraceDesk


def build_broker_side(
    current: CurrentConfig,
    outside: Outside,
    submit: Callable[[AnyCommand], None],
    found_counts: FoundCounts,
    *,
    switch_rule: SwitchRule = lambda _rule, _on: False,
    listen: Publish | None = None,
) -> BrokerSide:
    """Build what speaks with the broker.

    `submit` takes commands, `found_counts` what the broker retains of counts, `switch_rule` the
    switching of rules. `listen` is told what the broker is told.
    """
    config = current.config
    client, clock, budgets = outside.client, outside.clock, outside.budgets
    topics, outbox, link = Topics(config.mqtt.base_topic), Outbox(), LinkCheck(outside.nonce)
    publisher = MqttPublisher(
        current, topics, outbox, clock=clock, wall_clock=outside.wall_clock, budgets=budgets
    )
    announcer = Announcer(
        current, outbox, client.subscribe, client.unsubscribe, found_counts, budgets=budgets
    )
    desk = RequestDesk(topics, outbox, link, clock, budgets=budgets)
    publish = publisher.publish if listen is None else _both(publisher.publish, listen)
    intake = CommandIntake(
        current, topics, link, publish, submit, switch_rule=switch_rule, budgets=budgets
    )
    status_topic = config.homeassistant.status_topic
    filters = (one.topic_filter for one in topics.subscriptions(status_topic))
    session = Session(
        topics=topics,
        status_topic=status_topic,
        outbox=outbox,
        publisher=publisher,
        link=link,
        access=CommandProbe(filters, outside.nonce),
        intake=intake,
        desk=desk,
        announcer=announcer,
        log_lines=outside.log_lines,
        publish=client.publish,
        leave_mute=client.leave_mute,
        connect_anew=client.connect_anew,
        all_sent=trim_heap,
        jitter_s=outside.jitter_s,
        repeat_s=config.mqtt.repeat_s,
        budgets=budgets,
    )
    return BrokerSide(topics, outbox, link, publisher, publish, announcer, desk, intake, session)


def _both(first: Publish, second: Publish) -> Publish:
    def publish(event: PublicEvent) -> None:
        first(event)
        second(event)

    return publish


def build_tree(
    config: Config,
    outside: Outside,
    make_worker: Callable[[LineConfig], Worker],
    report: Callable[[ErrandTold | LinePassed], None],
    *,
    load: Callable[[], Config] | None = None,
    memory: Memory | None = None,
    notifier: Notifier | None = None,
    listen: Publish | None = None,
) -> Tree:
    """Build everything of the main thread; each desk serves its requests, and nothing starts.

    Args:
        config: The configuration to begin with.
        outside: What it stands on.
        make_worker: Makes the worker of a line.
        report: Brings an event from the thread of a line to the main thread.
        load: Reads the configuration again; None: there is but one.
        memory: What the run before this one left behind.
        notifier: systemd; None: there is none.
        listen: Is told what the broker is told, such as the panel in the browser.
    """
    clock, budgets = outside.clock, outside.budgets
    current, memory = CurrentConfig(config), memory or Memory()
    broker = build_broker_side(
        current,
        outside,
        lambda command: hub.submit(command),  # noqa: PLW0108  # both are made below
        lambda found: counts.found(found),  # noqa: PLW0108
        switch_rule=lambda rule, on: hub.rules.switch(rule, on=on),
        listen=listen,
    )
    publisher, desk = broker.publisher, broker.desk
    lines = LineSet(make_worker, memory.loss)
    counts = Counts(current, broker.publish)
    count_keeper = CountKeeper(current, counts, budgets=budgets)
    rule_keeper = RuleKeeper(current, memory, budgets=budgets)
    hub = Hub(current, broker.publish, lines.workers, counts, clock, memory=memory)
    reload = Reload(
        current=current,
        load=load or (lambda: config),
        lines=lines,
        hub=hub,
        session=broker.session,
        desk=desk,
        notifier=notifier or Notifier({}),
        clock=clock,
        budgets=budgets,
    )
    errands = ErrandDesk(current, lines.workers, desk, report, clock)
    traces = TraceDesk(
        current=current,
        lines=lines.workers,
        desk=desk,
        topics=broker.topics,
        link=broker.link,
        publish=outside.client.publish,
        tell=report,
        clock=clock,
        wall_clock=outside.wall_clock,
    )
    for opened in (reload, Services(desk, broker.announcer, publisher, clock), errands, traces):
        opened.open()
    return Tree(
        current, broker, lines, counts, count_keeper, rule_keeper, hub, reload, errands, traces
    )
