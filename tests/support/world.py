"""The MQTT side of a bridge on a virtual clock, before a broker that takes what it is given."""

import queue
from collections.abc import Mapping  # noqa: TC003  # as all the others
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

from support.links import prove
from support.mqtt_side import CONFIG, FakeConnection

from bridge.config.current import CurrentConfig
from bridge.config.schema import Config
from bridge.daemon.wiring import Outside, build_broker_side
from bridge.model import AnyCommand  # noqa: TC001  # as all the others
from bridge.mqtt.events import Acknowledged, OutMessage, Received
from bridge.mqtt.log_handler import LogLine

STARTED = datetime(2024, 5, 1, 12, tzinfo=UTC)


class World:
    """All of it, built as the daemon builds it. A test uses the parts that it is about.

    Attributes:
        now: The clock, in seconds.
        wall_moved_s: By how much the clock on the wall was set since.
        jitter_s: How long an answer to a birth waits.
        left_at: When another server was asked for.
        submitted: The commands that got through the intake.
        found: The counts that the broker retained, as the announcer found them.
        switched: The rules that were switched; there is one, `stairs`.
    """

    def __init__(self, config: Config = CONFIG, *, now: float = 0.0) -> None:
        self.now = now
        self.wall_moved_s = 0.0
        self.jitter_s = 0.0
        self.left_at: list[float] = []
        self.submitted: list[AnyCommand] = []
        self.found: list[Mapping[tuple[str, int], int]] = []
        self.switched: list[tuple[str, bool]] = []
        self.log_lines = queue.Queue[LogLine]()
        self.current = CurrentConfig(config)
        self.connection = FakeConnection(leave_mute=lambda: self.left_at.append(self.now))
        self.side = build_broker_side(
            self.current,
            Outside(
                self.connection,
                self.clock,
                lambda: STARTED + timedelta(seconds=self.now + self.wall_moved_s),
                self.log_lines,
                lambda: self.jitter_s,
                nonce="probe",
            ),
            self.submitted.append,
            self.found.append,
            switch_rule=self._switch,
        )
        self.outbox, self.link, self.desk = self.side.outbox, self.side.link, self.side.desk
        self.publisher, self.session = self.side.publisher, self.side.session
        self.announcer = self.side.announcer

    def _switch(self, rule: str, on: bool) -> bool:
        self.switched.append((rule, on))
        return rule == "stairs"

    def clock(self) -> float:
        """Return the instant."""
        return self.now

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
        self.desk.receive(verb, Received(topic, payload, retain, self.now))

    def pumped(self) -> list[OutMessage]:
        """Let the broker take and acknowledge what the outbox has, and return it."""
        self.outbox.pump(self.connection.publish, self.now)
        while self.connection.unacknowledged:
            self.outbox.acknowledged(self.connection.unacknowledged.pop(0))
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
