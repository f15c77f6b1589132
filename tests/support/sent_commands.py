"""Commands to the panel that can be told apart on the wire, and what the wire says of them."""

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, STATIONS, results

from bridge.simulator.module import Switching

OUTPUTS = [(name, n) for name, (_, model) in STATIONS.items() for n in range(1, model.outputs + 1)]

Orders = list[tuple[str, Switching]]


@dataclass(frozen=True, slots=True)
class SentCommand:
    """One command: when it was published, and what it asks for."""

    command_id: str
    at: float
    station_id: str
    output: int
    value: bool

    def fits(self, station_id: str, order: Switching) -> bool:
        """Return whether an order on the wire can belong to this command."""
        asked = (self.station_id, self.output, self.value)
        return asked == (station_id, order.output, order.value) and self.at <= order.at


class SentCommands:
    """Each output of the panel in turn, ON and OFF in turn: equal ones are seconds apart."""

    def __init__(self, outputs: Sequence[tuple[str, int]] = OUTPUTS) -> None:
        self.sent: dict[str, SentCommand] = {}
        self._outputs = outputs
        self._numbers = count()

    def publish(self, probe: MqttProbe, *, times: int = 1) -> None:
        """Publishes one more, `times` times: a sender that heard nothing says it again."""
        number = next(self._numbers)
        name, output = self._outputs[number % len(self._outputs)]
        value = number // len(self._outputs) % 2 == 0
        command_id = f"{name} n{number}"
        self.sent[command_id] = SentCommand(command_id, time.monotonic(), name, output, value)
        wish = json.dumps({"state": "ON" if value else "OFF", "id": command_id})
        for _ in range(times):
            probe.publish(f"{BASE}/{name}/do/{output}/set", wish)

    def waited_s(self, orders: Orders) -> list[float]:
        """Return how long each command that was carried out waited."""
        waits = []
        for sent in self.sent.values():
            at = [order.at for station_id, order in orders if sent.fits(station_id, order)]
            if at:
                waits.append(min(at) - sent.at)
        return waits

    def late(self, orders: Orders, deadline_s: float) -> int:
        """Return the number of orders without a command younger than `deadline_s`."""
        late = 0
        left = dict(self.sent)
        for station_id, order in sorted(orders, key=lambda item: item[1].at):
            fitting = [
                sent.command_id
                for sent in left.values()
                if sent.fits(station_id, order) and order.at - sent.at <= deadline_s
            ]
            if fitting:
                del left[fitting[0]]
            late += not fitting
        return late


def verdicts(seen: list[Seen], command_id: str) -> list[dict[str, object]]:
    """The verdicts on the commands with this id."""
    return [verdict for verdict in results(seen) if verdict.get("id") == command_id]


def wait_until_fresh(probe: MqttProbe, patience_s: float = 60.0) -> None:
    """Waits until the bridge takes commands again: what was on its way before came through.

    It asks for an output that no module has, so that nothing is switched.
    """
    deadline = time.monotonic() + patience_s
    for command_id in _marks():
        assert time.monotonic() < deadline, "the bridge takes no commands again"
        probe.publish(f"{BASE}/pumps/do/99/set", json.dumps({"state": "ON", "id": command_id}))
        if _reason(probe, command_id) == "no_such_channel":
            return
        time.sleep(0.25)  # the link is not proven yet, or the bridge not connected


def _marks() -> Iterator[str]:
    began = time.monotonic()
    return (f"fresh {began} {number}" for number in count())


def _reason(probe: MqttProbe, command_id: str) -> object:
    try:
        seen = probe.wait_for(lambda seen: bool(verdicts(seen, command_id)), 1.0)
    except AssertionError:  # it never reached the bridge
        return None
    return verdicts(seen, command_id)[0].get("reason")
