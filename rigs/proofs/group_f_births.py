"""Births of Home Assistant while states change and commands are answered: F11."""

import random
from collections import defaultdict

from support.house import make_config

from bridge.config.schema import InputConfig, OutputConfig, StationConfig
from bridge.model import DIO100, Status, ValuesChanged, Verdict
from bridge.mqtt.events import OutMessage
from proofs.far_broker import FarBroker
from proofs.figures import Figure, Run, proof

WAY_S = 0.06
STATIONS = 31
STEP_S = 0.01
CHANGE_EACH = 5  # steps
FRESH_S = 2.0
PERIODS_S = (0.05, 0.1, 0.3, 1.0, 2.0)


def _station(address: int) -> StationConfig:
    return StationConfig(
        address=address,
        model=DIO100,
        id=f"s{address}",
        name=f"Station {address}",
        inputs=tuple(InputConfig(n) for n in range(1, 17)),
        outputs=tuple(OutputConfig(n) for n in range(1, 9)),
    )


class _House:
    """31 stations that change and answer commands.

    Attributes:
        oldest_s: How old a state was at most when it was told.
        early: Verdicts that were told before their state.
        births: How often Home Assistant was started.
    """

    def __init__(self, period_s: float) -> None:
        config = make_config(stations=tuple(_station(n) for n in range(1, STATIONS + 1)))
        self.broker = FarBroker(config, WAY_S, self._arrived)
        self.oldest_s = 0.0
        self.early = 0
        self.births = 0
        self._period_s = period_s
        self._random = random.Random(period_s)  # noqa: S311  # no secret
        self._values = dict.fromkeys(range(1, STATIONS + 1), (0, 0))
        self._untold: dict[str, list[float]] = defaultdict(list)  # topic: when it changed
        self._told: dict[str, float] = {}  # topic: when its newest value at the broker was sent
        self._verdicts: dict[str, tuple[float, list[str]]] = {}  # id: when, and what changed

    def live(self, seconds: float) -> None:
        """Lets so much time pass, and a rest in which all is told."""
        self.broker.connect()
        for address in self._values:
            self._change(address, 0xFFFF, 0xFF)
        self._settle()
        for step in range(round(seconds / STEP_S)):
            if step * STEP_S >= self.births * self._period_s:
                self.births += 1
                self.broker.birth()
            if step % CHANGE_EACH == 0:
                address = self._random.randint(1, STATIONS)
                inputs, outputs = self._values[address]
                self._change(address, inputs ^ 1 << self._random.randrange(16), outputs ^ 1)
            self.broker.step(STEP_S)
        self._settle()
        self.early += len(self._verdicts)  # none is left out
        self.oldest_s = max(self.oldest_s, FRESH_S * 2 * any(self._untold.values()))

    def _settle(self) -> None:
        for _ in range(round(2 * FRESH_S / STEP_S)):
            self.broker.step(STEP_S)

    def _change(self, address: int, inputs: int, outputs: int) -> None:
        old_inputs, old_outputs = self._values[address]
        self._values[address] = inputs, outputs
        base = f"wisco/s{address}"
        flips = (("di", 16, inputs ^ old_inputs), ("do", 8, outputs ^ old_outputs))
        topics = [
            f"{base}/{kind}/{n + 1}"
            for kind, count, bits in flips
            for n in range(count)
            if bits >> n & 1
        ]
        now = self.broker.now
        for topic in [*topics, base] if topics else []:
            self._untold[topic].append(now)
        self.broker.publisher.publish(ValuesChanged(f"s{address}", inputs, outputs))
        command_id = str(len(self._told) * 1000 + len(self._verdicts)) + f" {now}"
        self._verdicts[command_id] = now, [*topics, base]
        self.broker.publisher.publish(
            Verdict(f"s{address}", "do/1", "TOGGLE", Status.DONE, 1, id=command_id)
        )

    def _arrived(self, message: OutMessage, sent_at: float, now: float) -> None:
        if message.topic.endswith("/result"):
            command_id = message.payload.split(b'"id":"')[1].split(b'"')[0].decode()
            at, topics = self._verdicts.pop(command_id)
            self.early += any(self._told.get(topic, -1.0) < at for topic in topics)
            return
        self._told[message.topic] = sent_at
        told = [at for at in self._untold[message.topic] if at <= sent_at]
        self._untold[message.topic] = [at for at in self._untold[message.topic] if at > sent_at]
        if self.births:  # the first burst is no matter of a birth
            self.oldest_s = max([self.oldest_s, *(now - at for at in told)])


@proof("F11")
def births_neither_delay_nor_turn_around(run: Run) -> Figure:
    """Home Assistant is started again and again, by a broker that is some way off."""
    seconds = run.scale.of(4, 300)
    houses = [_House(period_s) for period_s in PERIODS_S]
    for house in houses:
        house.live(seconds)
    oldest_s = max(house.oldest_s for house in houses)
    early = sum(house.early for house in houses)
    return Figure(
        injected=f"{sum(house.births for house in houses)} births, one each "
        f"{PERIODS_S[0]:g}-{PERIODS_S[-1]:g} s, the broker {WAY_S * 1000:.0f} ms away, "
        f"{STATIONS} stations with a command each {CHANGE_EACH * STEP_S * 1000:.0f} ms",
        seen=f"every state told within {oldest_s:.2f} s; {early} verdicts before their state",
        promised=f"every state within {FRESH_S:.0f} s, 0 verdicts before their state",
        kept=oldest_s <= FRESH_S and early == 0,
    )
