"""The MQTT side of many bridges in one process; their lines only tell states."""

import queue
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from support.fake_worker import FakeWorker

from bridge.clock import boot_s
from bridge.config.schema import (
    Config,
    HomeAssistantConfig,
    InputConfig,
    LineConfig,
    MqttConfig,
    OutputConfig,
    StationConfig,
)
from bridge.daemon.wiring import Outside, Tree, build_tree
from bridge.model import (
    DIO100,
    LineChanged,
    LineEvent,
    LineProtocol,
    OutputSettings,
    SettingsRead,
    StationChanged,
    ValuesChanged,
)
from bridge.mqtt.backlog import EventQueue
from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import MqttEvent, OutMessage
from bridge.mqtt.payloads import OFFLINE
from bridge.mqtt.topics import Topics

LINES, MODULES = 8, 32  # of each bridge
STATUS = "homeassistant/status"  # one for all, so that all answer at once
_EVENTS_A_ROUND = 200


def configuration(number: int, port: int) -> Config:
    """Return that of one cabinet with every address of eight lines in use."""
    base = f"site{number // 10}/cabinet{number}"
    lines = tuple(
        LineConfig(
            f"line{line}",
            f"tcp://10.0.0.{line}:4196",
            9600,
            LineProtocol.MODBUS_RTU,
            tuple(_station(line, address) for address in range(MODULES)),
        )
        for line in range(LINES)
    )
    return Config(
        MqttConfig("127.0.0.1", port, base, f"fleet-{number}", "5"),
        HomeAssistantConfig("device", f"{base}/homeassistant", STATUS),
        Path("/nowhere"),
        lines,
    )


def _station(line: int, address: int) -> StationConfig:
    name = f"line{line}_{address:02}"
    return StationConfig(
        address=address,
        model=DIO100,
        id=name,
        name=name,
        inputs=tuple(InputConfig(n) for n in range(1, DIO100.inputs + 1)),
        outputs=tuple(OutputConfig(n) for n in range(1, DIO100.outputs + 1)),
    )


@dataclass
class Traffic:
    """What was published, by all bridges: topics and payloads, without the frames around them."""

    messages: int = 0
    octets: int = 0


class _CountedClient:
    """The client of a bridge, and the count of what it is given."""

    def __init__(self, client: MqttClient, traffic: Traffic) -> None:
        self._client = client
        self._traffic = traffic
        self.subscribe = client.subscribe
        self.unsubscribe = client.unsubscribe
        self.leave_mute = client.leave_mute
        self.connect_anew = client.connect_anew

    def publish(self, message: OutMessage) -> int | None:
        token = self._client.publish(message)
        if token is not None:
            self._traffic.messages += 1
            self._traffic.octets += len(message.topic) + len(message.payload)
        return token


class OneBridge:
    """Hub, session, outbox, announcer and client of one bridge."""

    def __init__(self, number: int, port: int, traffic: Traffic) -> None:
        self.config = configuration(number, port)
        self._events: EventQueue[MqttEvent] = EventQueue()
        self._inputs = dict.fromkeys((s.id for _, s in self.config.all_stations), 0)
        topics = Topics(self.config.mqtt.base_topic)
        self._client = MqttClient(
            self.config.mqtt,
            topics.subscriptions(self.config.homeassistant.status_topic),
            self._events.put,
            OutMessage(topics.bridge_state, OFFLINE, qos=1, retain=True),
            backlog=self._events.backlog,
        )
        outside = Outside(_CountedClient(self._client, traffic), boot_s)
        self._tree: Tree = build_tree(self.config, outside, FakeWorker, lambda _told: None)

    @property
    def drained(self) -> bool:
        """Return whether the broker has all of it."""
        return self._client.connected and self._tree.broker.session.drained

    @property
    def connections(self) -> int:
        """Return how many there were so far."""
        return self._client.counters.connections

    def start(self) -> None:
        """Connect, as lines and modules come online."""
        for event in self._coming_online():
            self._tree.hub.apply(event)
        self._client.start()

    def change(self, chance: random.Random) -> None:
        """Change an input of some module."""
        station = chance.choice(list(self._inputs))
        self._inputs[station] ^= 1 << chance.randrange(DIO100.inputs)
        self._tree.hub.apply(ValuesChanged(station, self._inputs[station], 0))

    def turn(self) -> None:
        """Do a round of the main thread."""
        session = self._tree.broker.session
        for _ in range(_EVENTS_A_ROUND):
            try:
                session.handle(self._events.get_nowait(), boot_s())
            except queue.Empty:
                break
        session.tick(boot_s())

    def stop(self) -> None:
        """End the connection."""
        self._client.stop(0.0)

    def _coming_online(self) -> Iterator[LineEvent]:
        settings = OutputSettings(0, (10,) * DIO100.outputs)
        for line in self.config.lines:
            yield LineChanged(line.id, online=True, detail="")
            for station in line.stations:
                yield SettingsRead(station.id, settings)
                yield ValuesChanged(station.id, 0, 0)
                yield StationChanged(station.id, online=True, detail="")
