"""A session between a hub that notes and a broker that takes all."""

import json
from typing import Any, Self

from support.world import World

from bridge.mqtt.announce.survey import QUIET_S
from bridge.mqtt.events import (
    Connected,
    Disconnected,
    OutMessage,
    Received,
    Subscribed,
)
from bridge.mqtt.link import SETTLING_S

LAMP = "wisco/garage/do/1/set"
ACCESS_PROBES = tuple(
    f"wisco/bridge/{rest}"
    for rest in (
        "do/bridge/set",
        "set",
        "do/bridge/mode/set",
        "do/bridge/hold/set",
        "cover/bridge/set",
        "cover/bridge/position/set",
        "rule/bridge/set",
        "request/bridge",
    )
)
PROBES = ("wisco/bridge/ping", *ACCESS_PROBES)


class LiveSession(World):
    """A session between a hub that notes and a broker that takes all."""

    @classmethod
    def connected(cls) -> Self:
        """Return a session that is connected and has told everything."""
        live = cls()
        live.connect()
        live.sent()
        for topic in ACCESS_PROBES:
            live.receive(topic, b"probe")
        return live

    def connect(self, protocol: str = "5") -> None:
        """The broker took us, retains nothing of ours, and has said so by now."""
        at = self.now - QUIET_S - SETTLING_S
        self.connection.up = True
        self.session.handle(Connected(protocol, at), at)
        self.session.tick(at)
        pings = [m.payload for m in self.connection.sent if m.topic == PROBES[0]]
        self.session.handle(Received(PROBES[0], pings[-1], retain=False, at=at), at)
        self.session.handle(Subscribed(()), at)

    def cut(self) -> None:
        """The connection ends; what was under way is lost."""
        self.connection.up = False
        self.connection.unacknowledged.clear()
        self.session.handle(Disconnected("test", self.now), self.now)

    def sent(self) -> list[OutMessage]:
        """Let the broker take and acknowledge all that is due; return it without probes."""
        return [m for m in self.settled() if m.topic not in PROBES]

    def topics(self) -> list[str]:
        """The same as topics."""
        return [message.topic for message in self.sent()]

    def verdict(self) -> Any:
        """The one message that went out, which must be a verdict of the garage."""
        [message] = self.sent()
        assert message.topic == "wisco/garage/result"
        return json.loads(message.payload)

    def pass_time(self, seconds: float, *, answer: bool = True, lost: tuple[str, ...] = ()) -> None:
        """Lets time pass in steps of 0.1 s; probes come back if `answer`, but not those `lost`."""
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            before = len(self.connection.sent)
            self.session.tick(self.now)
            for message in self.connection.sent[before:]:
                if answer and message.topic in PROBES and message.topic not in lost:
                    self.receive(message.topic, message.payload)
