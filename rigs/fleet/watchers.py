"""Clients of each node of a cluster: what they believe, what they hear, what they send."""

import json
import queue
import random
import time
from collections.abc import Sequence
from typing import Any

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from soak.ledger import Ledger

from fleet.house import BASE, LATCHES, PULSE, STATIONS

_CONNECTING_S = 5.0


class Watcher:
    """One connection, without a memory: when it ends, another one begins.

    Attributes:
        states: The latest payload of each topic, since this connection began.
    """

    def __init__(self, port: int, topics: Sequence[str]) -> None:
        self.states: dict[str, bytes] = {}
        self._topics = topics
        self._until = time.monotonic() + _CONNECTING_S
        self._failed = False
        self._client = Client(
            CallbackAPIVersion.VERSION2,
            protocol=MQTTProtocolVersion.MQTTv311,
            reconnect_on_failure=False,
        )
        self._client.on_connect = self._subscribe
        self._client.on_message = self._take
        try:
            self._client.connect("127.0.0.1", port, keepalive=5)
        except OSError:
            self._failed = True
        else:
            self._client.loop_start()

    @property
    def connected(self) -> bool:
        """Return whether the broker took it."""
        return self._client.is_connected()

    @property
    def over(self) -> bool:
        """Return whether another connection is due."""
        return self._failed or (not self.connected and time.monotonic() > self._until)

    def publish(self, topic: str, payload: str) -> None:
        """Publish with QoS 1."""
        self._client.publish(topic, payload, 1)

    def close(self) -> None:
        """End it."""
        self._client.on_message = None
        self._client.disconnect()
        self._client.loop_stop()

    def _subscribe(self, client: Client, *_: Any) -> None:
        self._until = 0.0
        for first in range(0, len(self._topics), 20):
            client.subscribe([(topic, 0) for topic in self._topics[first : first + 20]])

    def _take(self, _client: Client, _userdata: Any, message: MQTTMessage) -> None:
        self.states[message.topic] = bytes(message.payload)


class Commander(Watcher):
    """A client that also commands, and hears verdicts and pings."""

    def __init__(
        self, port: int, topics: Sequence[str], heard: "queue.Queue[tuple[float, str, bytes]]"
    ) -> None:
        self._heard = heard
        own = [f"{BASE}/bridge/ping", *(f"{BASE}/{station}/result" for station in STATIONS)]
        super().__init__(port, [*own, *topics])

    def _take(self, client: Client, userdata: Any, message: MQTTMessage) -> None:
        super()._take(client, userdata, message)
        if message.topic.endswith(("/result", "/ping")):
            self._heard.put((time.monotonic(), message.topic, bytes(message.payload)))


class Clients:
    """One commander at each node, and the books of what they asked for.

    Attributes:
        duplicates: Commands that a broker brought twice, and the bridge refused.
    """

    def __init__(
        self, ports: Sequence[int], topics: Sequence[str], ledger: Ledger, chance: random.Random
    ) -> None:
        self.duplicates = 0
        self._ports = ports
        self._topics = topics
        self._ledger = ledger
        self._chance = chance
        self._heard: queue.Queue[tuple[float, str, bytes]] = queue.Queue()
        self._answers: dict[int, bytes] = {}
        self._at: dict[int, Commander] = {}

    def keep_connected(self, live: Sequence[int]) -> None:
        """Begin a connection to each of these nodes where there is none."""
        for number in live:
            if number in self._at and self._at[number].over:
                self._at.pop(number).close()
            if number not in self._at:
                self._at[number] = Commander(self._ports[number], self._topics, self._heard)

    def states(self, number: int) -> dict[str, bytes]:
        """Return what the client at a node believes."""
        return dict(self._at[number].states) if self._at[number].connected else {}

    def command(self) -> None:
        """Send one command to any module, by any node that takes it."""
        able = [client for client in self._at.values() if client.connected]
        if not able:
            return
        station = self._chance.choice(list(STATIONS))
        output = self._chance.choice((PULSE, PULSE, *LATCHES))
        word = "PRESS" if output == PULSE else self._chance.choice(("ON", "OFF", "TOGGLE"))
        wanted = {output: None if word == "TOGGLE" else word != "OFF"}
        number = self._ledger.sent(station, wanted, time.monotonic())
        payload = json.dumps({"state": word, "id": number})
        self._chance.choice(able).publish(f"{BASE}/{station}/do/{output}/set", payload)

    def listen(self) -> None:
        """Take in what was heard: each node brings the same, and a copy is no second verdict."""
        while not self._heard.empty():
            at, topic, payload = self._heard.get()
            if topic.endswith("/ping"):
                self._ledger.link.ping(at)
                continue
            verdict = json.loads(payload)
            number = verdict.get("id")
            if verdict.get("reason") == "duplicate":
                self.duplicates += 1
            elif number is not None and self._answers.get(number) != payload:
                self._answers[number] = payload
                self._ledger.answered(number, payload, verdict, at)

    def close(self) -> None:
        """End them; `keep_connected` begins new ones."""
        while self._at:
            self._at.popitem()[1].close()
