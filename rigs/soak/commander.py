"""Sends commands of every kind, and hears verdicts, states and pings. One thread uses it."""

import json
import queue
import random
import time
from dataclasses import dataclass
from typing import Any

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from soak.house import (
    BASE,
    COVERS,
    DEAD,
    FUZZED,
    INTERLOCKED,
    LIVE,
    MAX_ON,
    ON_LOSS,
    PULSE,
    READ_ONLY,
    Home,
)
from soak.ledger import DEADLINE_S, Ledger

ANSWERS = "answers/soak"  # outside the bridge's own topics
BURST = 60
FUZZ = 30
DEAD_SHARE = 0.1  # of the commands go to modules that are not there
COVER_SHARE = 0.5  # of those to a module that has some
DEADLINES_S = (0.1, 0.5, 1.0, 10.0)


@dataclass(frozen=True, slots=True)
class Heard:
    """A message as it came."""

    at: float
    topic: str
    payload: bytes
    correlation: bytes


class Commander:
    """A client without a memory: what was on its way when the broker went is not sent again.

    Attributes:
        states: The latest payload of each topic below the base topic.
    """

    def __init__(self, port: int, ledger: Ledger, chance: random.Random) -> None:
        self.states: dict[str, bytes] = {}
        self._port = port
        self._ledger = ledger
        self._chance = chance
        self._heard: queue.Queue[Heard] = queue.Queue()
        self._client: Client | None = None

    # --- the connection -----------------------------------------------------------------------

    def keep_connected(self) -> None:
        """Connects anew where that is due; an absent broker is left for the next time."""
        if self._client is not None and self._client.is_connected():
            return
        self.close()
        client = Client(
            CallbackAPIVersion.VERSION2,
            protocol=MQTTProtocolVersion.MQTTv5,
            reconnect_on_failure=False,
        )
        client.on_connect = lambda client, *_: client.subscribe([(f"{BASE}/#", 1), (ANSWERS, 1)])
        client.on_message = self._take
        try:
            client.connect("127.0.0.1", self._port)
        except OSError:
            return
        client.loop_start()
        self._client = client
        give_up = time.monotonic() + 5.0
        while not client.is_connected() and time.monotonic() < give_up:
            time.sleep(0.01)

    def close(self) -> None:
        """Ends the connection."""
        if self._client is not None:
            self._client.disconnect()
            self._client.loop_stop()
            self._client = None

    def _take(self, _client: Client, _userdata: Any, message: MQTTMessage) -> None:
        correlation = getattr(message.properties, "CorrelationData", b"")
        self._heard.put(Heard(time.monotonic(), message.topic, bytes(message.payload), correlation))

    def listen(self) -> None:
        """Takes in what was heard since it was last called."""
        while not self._heard.empty():
            heard = self._heard.get()
            if heard.topic == ANSWERS:
                verdict = json.loads(heard.payload)
                self._ledger.answered(int(heard.correlation), heard.payload, verdict, heard.at)
            else:
                self.states[heard.topic] = heard.payload
                if heard.topic == f"{BASE}/bridge/ping":
                    self._ledger.link.ping(heard.at)

    # --- commands -----------------------------------------------------------------------------

    def command(self) -> None:
        """One command of any kind to any module, dead ones too."""
        home = self._chance.choice(DEAD if self._chance.random() < DEAD_SHARE else LIVE)
        kind = self._chance.choice((self._latch, self._latch, self._pulse, self._several))
        if home.has_covers and self._chance.random() < COVER_SHARE:
            kind = self._cover
        kind(home)

    def move_all(self) -> None:
        """Every motor of the house."""
        for home in LIVE:
            for cover in COVERS if home.has_covers else ():
                self._move(home, cover, self._chance.choice(("OPEN", "CLOSE")))

    def burst(self, home: Home) -> None:
        """More than a station takes in a second."""
        for _ in range(BURST):
            self._latch(home)

    def fuzz(self, home: Home) -> None:
        """Return a payload that no program should send."""
        for _ in range(FUZZ):
            self._send(home, f"do/{FUZZED}/set", self._rubbish(), {FUZZED: None})

    def _latch(self, home: Home) -> None:
        output = self._chance.choice((*home.latches, READ_ONLY, MAX_ON, ON_LOSS, *INTERLOCKED))
        word = self._chance.choice(("ON", "OFF", "TOGGLE"))
        wanted = {} if output == READ_ONLY else {output: _value(word)}
        self._word(home, f"do/{output}/set", word, wanted)

    def _pulse(self, home: Home) -> None:
        word = self._chance.choice(("PRESS", "ON"))
        self._word(home, f"do/{PULSE}/set", word, {PULSE: True})

    def _several(self, home: Home) -> None:
        outputs = [*home.latches, MAX_ON, ON_LOSS, *INTERLOCKED]
        outputs = self._chance.sample(outputs, self._chance.randint(2, 4))
        words = {n: self._chance.choice(("ON", "OFF")) for n in outputs}
        wish: dict[str, Any] = {"do": {str(n): word for n, word in words.items()}}
        self._wish(home, "set", wish, {n: w == "ON" for n, w in words.items()})

    def _cover(self, home: Home) -> None:
        cover = self._chance.choice(list(COVERS))
        if self._chance.random() < 0.2:
            position = self._chance.randint(0, 100)
            wanted = dict.fromkeys(COVERS[cover])
            self._wish(home, f"cover/{cover}/position/set", {"position": position}, wanted)
        else:
            self._move(home, cover, self._chance.choice(("OPEN", "CLOSE", "STOP")))

    def _move(self, home: Home, cover: str, word: str) -> None:
        outputs = zip(COVERS[cover], ("OPEN", "CLOSE"), strict=True)
        wanted: dict[int, bool | None] = {output: word == way for output, way in outputs}
        self._word(home, f"cover/{cover}/set", word, wanted)

    def _word(self, home: Home, target: str, word: str, wanted: dict[int, bool | None]) -> None:
        if self._chance.random() < 0.5:
            self._send(home, target, word.encode(), wanted)
        else:
            self._wish(home, target, {"state": word}, wanted)

    def _wish(
        self, home: Home, target: str, wish: dict[str, Any], wanted: dict[int, bool | None]
    ) -> None:
        deadline_s = DEADLINE_S
        if self._chance.random() < 0.3:
            wish["deadline"] = deadline_s = self._chance.choice(DEADLINES_S)
        self._send(home, target, json.dumps(wish).encode(), wanted, deadline_s)

    def _rubbish(self) -> bytes:
        if self._chance.random() < 0.5:
            return self._chance.randbytes(self._chance.randint(1, 200))
        good = bytearray(json.dumps({"state": "ON", "deadline": 1.5}).encode())
        for _ in range(self._chance.randint(1, 4)):
            good[self._chance.randrange(len(good))] = self._chance.randrange(256)
        return bytes(good)

    def _send(
        self,
        home: Home,
        target: str,
        payload: bytes,
        wanted: dict[int, bool | None],
        deadline_s: float = DEADLINE_S,
    ) -> None:
        # With no connection of our own nothing is sent: it would be queued, and not by the bridge.
        if self._client is None or not self._client.is_connected():
            return
        number = self._ledger.sent(home.id, wanted, time.monotonic(), deadline_s)
        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's gap
        properties.ResponseTopic = ANSWERS
        properties.CorrelationData = str(number).encode()
        self._client.publish(f"{BASE}/{home.id}/{target}", payload, 1, properties=properties)


def _value(word: str) -> bool | None:
    return None if word == "TOGGLE" else word == "ON"
