"""The MQTT side of a bridge on a virtual clock, before a broker that takes what it is given."""

import queue
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

from support.links import prove
from support.mqtt_side import CONFIG, FakeConnection

from bridge.config.schema import Config
from bridge.model import AnyCommand
from bridge.mqtt.access import CommandProbe
from bridge.mqtt.announce.announcer import Announcer
from bridge.mqtt.events import Acknowledged, OutMessage, Received
from bridge.mqtt.intake import CommandIntake
from bridge.mqtt.link import LinkCheck
from bridge.mqtt.log_handler import LogLine
from bridge.mqtt.outbox import WINDOW, Outbox
from bridge.mqtt.publisher import MqttPublisher
from bridge.mqtt.requests import RequestDesk
from bridge.mqtt.session import Session
from bridge.mqtt.topics import Topics

STARTED = datetime(2024, 5, 1, 12, tzinfo=UTC)


class World:
    """All of it, composed as the daemon does. A test uses the parts that it is about.

    Attributes:
        now: The clock, in seconds.
        wall_moved_s: By how much the clock on the wall was set since.
        jitter_s: How long an answer to a birth waits.
        left_at: When another server was asked for.
        submitted: The commands that got through the intake.
        found: The counts that the broker retained, as the announcer found them.
    """

    def __init__(self, config: Config = CONFIG, *, now: float = 0.0, window: int = WINDOW) -> None:
        self.now = now
        self.wall_moved_s = 0.0
        self.jitter_s = 0.0
        self.left_at: list[float] = []
        self.submitted: list[AnyCommand] = []
        self.found: list[Mapping[tuple[str, int], int]] = []
        self.connection = FakeConnection()
        self.log_lines = queue.Queue[LogLine]()
        self.names = Topics(config.mqtt.base_topic)
        self.outbox, self.link = Outbox(window), LinkCheck("run")
        self.desk = RequestDesk(self.names, self.outbox, self.link, self.clock)
        self.publisher = MqttPublisher(
            config, self.names, self.outbox, clock=self.clock, wall_clock=self.wall_clock
        )
        self.announcer = Announcer(
            config,
            self.outbox,
            self.connection.subscribe,
            self.connection.unsubscribe,
            self.take_found,
        )
        stations = {station.id: station for line in config.lines for station in line.stations}
        self.session = Session(
            topics=self.names,
            status_topic=config.homeassistant.status_topic,
            outbox=self.outbox,
            publisher=self.publisher,
            link=self.link,
            access=CommandProbe(["wisco/+/do/+/set", "wisco/+/set", "wisco/bridge/ping"], "probe"),
            intake=CommandIntake(stations, self.names, self.link, self.publisher, self.submit),
            desk=self.desk,
            announcer=self.announcer,
            log_lines=self.log_lines,
            publish=self.connection.publish,
            jitter_s=lambda: self.jitter_s,
            leave_mute=lambda: self.left_at.append(self.now),
        )

    def clock(self) -> float:
        """Return the instant."""
        return self.now

    def wall_clock(self) -> datetime:
        """Return what the clock on the wall shows."""
        return STARTED + timedelta(seconds=self.now + self.wall_moved_s)

    def submit(self, command: AnyCommand) -> None:
        """Take a command that got through the intake."""
        self.submitted.append(command)

    def take_found(self, counts: Mapping[tuple[str, int], int]) -> None:
        """Take the counts that the broker retained."""
        self.found.append(counts)

    def come_up(self) -> None:
        """Make a connection of which the link is proven; the session is not told."""
        self.outbox.connected([], self.now)
        prove(self.link, self.now)

    def receive(self, topic: str, payload: bytes = b"ON", **more: Any) -> None:
        """Let a message arrive at the session."""
        message = Received(topic, payload, retain=False, at=self.now)
        self.session.handle(replace(message, **more), self.now)

    def ask(self, verb: str, payload: bytes = b"", *, retain: bool = False) -> None:
        """Let a request arrive at the desk."""
        topic = f"wisco/bridge/request/{verb}"
        self.desk.take(verb, Received(topic, payload, retain, self.now))

    def pumped(self) -> list[OutMessage]:
        """Return what the outbox lets out now."""
        self.outbox.pump(self.connection.publish, self.now)
        return self.connection.taken()

    def settled(self) -> list[OutMessage]:
        """Let the broker take and acknowledge all that is due, and return it."""
        self.session.tick(self.now)
        while self.connection.unacknowledged:
            token = self.connection.unacknowledged.pop(0)
            self.session.handle(Acknowledged(token), self.now)
            self.session.tick(self.now)
        return self.connection.taken()
