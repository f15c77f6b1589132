"""A daemon at work on a simulated line, and requests to it: for what it does between its polls."""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from support.daemon import Daemon
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, broker, is_complete, panel, write_config

from bridge.model import DO100, LineProtocol
from bridge.simulator.faults import is_write
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from bridge.simulator.wire import Direction

STRANGER = 9  # a DO100 that nobody has configured
PATIENCE_S = 90.0  # a wait ends as soon as its condition holds


@dataclass(frozen=True)
class LineHouse:
    """A daemon, its broker, and its line `main`: `garage`, `pumps`, and a module not configured."""

    line: SimulatedLine
    config: Path
    broker_port: int
    probe: MqttProbe
    daemon: Daemon

    def ask(self, verb: str, request_id: str, **arguments: object) -> None:
        """Sends a request."""
        request = {**{key.rstrip("_"): value for key, value in arguments.items()}, "id": request_id}
        self.probe.publish(f"{BASE}/bridge/request/{verb}", json.dumps(request))

    def answers(self, verb: str, request_id: str) -> list[dict[str, Any]]:
        """Return the answers so far."""
        return answers(self.probe.seen, verb, request_id)

    def under_way(self, verb: str, request_id: str) -> dict[str, Any]:
        """Waits until it is under way, and gives what was told."""
        self.probe.wait_for(lambda seen: bool(answers(seen, verb, request_id)))
        told = self.answers(verb, request_id)[0]
        assert told["status"] == "ok", told
        assert told["data"]["final"] is False
        return told

    def final(self, verb: str, request_id: str) -> dict[str, Any]:
        """Waits for the last answer."""

        def ended(seen: list[Seen]) -> bool:
            told = answers(seen, verb, request_id)
            return bool(told) and told[-1]["data"].get("final", True)

        self.probe.wait_for(ended, PATIENCE_S)
        return self.answers(verb, request_id)[-1]

    def refusal(self, verb: str, request_id: str, **arguments: object) -> str:
        """Sends a request that must be refused, and gives why it was."""
        self.ask(verb, request_id, **arguments)
        answer = self.final(verb, request_id)
        assert (answer["status"], answer["data"]) == ("error", {})
        return str(answer["error"])

    def writes(self) -> list[bytes]:
        """The frames on the wire that would change something."""
        return [frame for frame in self.sent() if is_write(frame)]

    def sent(self) -> list[bytes]:
        """The frames that went to the modules."""
        return [entry.data for entry in self.line.log if entry.direction is Direction.TO_MODULES]


def answers(seen: list[Seen], verb: str, request_id: str) -> list[dict[str, Any]]:
    """The answers to one request, oldest first."""
    told = [json.loads(m.payload) for m in seen if m.topic == f"{BASE}/bridge/response/{verb}"]
    return [answer for answer in told if answer.get("id") == request_id]


@contextmanager
def line_house(
    directory: Path, protocol: LineProtocol, *, paced: bool = True
) -> Iterator[LineHouse]:
    """All of it, online; in the end the daemon is well."""
    with ExitStack() as stack:
        mosquitto = stack.enter_context(broker(directory))
        line = stack.enter_context(panel(protocol, paced=paced))
        line.modules[STRANGER] = SimulatedModule(DO100, STRANGER)
        config = write_config(directory, line, mosquitto.port)
        probe = stack.enter_context(MqttProbe(mosquitto.port, f"{BASE}/#"))
        daemon = stack.enter_context(Daemon(config))
        probe.wait_for(is_complete)
        probe.clear()
        yield LineHouse(line, config, mosquitto.port, probe, daemon)
        assert "Traceback" not in daemon.log
