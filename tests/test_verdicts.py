"""Every status and reason of docs/contract.md's table comes out of the real bridge.

On a virtual line.

Intake, hub, worker and publisher are the real ones; port, clock and broker are not.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from support.links import prove
from support.mqtt_side import FakeConnection
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import Config, HomeAssistantConfig, MqttConfig, OutputConfig
from bridge.daemon.wiring import Outside, build_tree
from bridge.model import (
    DO100,
    LineEvent,
    LineMeasured,
    LineProtocol,
    Reason,
    StationMeasured,
    Status,
)
from bridge.mqtt.events import Received
from bridge.mqtt.topics import CommandTarget
from bridge.simulator.module import SimulatedModule

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 105.0  # when the command comes
END = 112.0


def _wall_clock() -> datetime:
    return datetime(2024, 5, 1, tzinfo=UTC)


class Bridge(VirtualWorker):
    """One station `s1` behind all of the bridge but its threads, its port and its client.

    Output 8 is read-only, 1 and 2 are interlocked, three commands a second are let through.
    """

    def __init__(self) -> None:
        outputs = (*map(OutputConfig, range(1, 8)), OutputConfig(8, read_only=True))
        config = replace(make_station(outputs=outputs), rate_limit=3.0, interlock=(0b11,))
        line = make_line(config, protocol=LineProtocol.MODBUS_RTU)
        whole = Config(
            mqtt=MqttConfig("localhost", 1883, "wisco", "me", "auto"),
            homeassistant=HomeAssistantConfig("off", "homeassistant", "homeassistant/status"),
            state_dir=Path("/nowhere"),
            lines=(line,),
        )
        super().__init__(line)
        tree = build_tree(
            whole,
            Outside(FakeConnection(), self.line.clock, _wall_clock),
            lambda _line: self.worker,
            lambda _told: None,
        )
        tree.lines.workers["main"] = self.worker
        self._hub, self.link, self.intake = tree.hub, tree.broker.link, tree.broker.intake
        self._topics, self._outbox = tree.broker.topics, tree.broker.outbox
        self.pings = True

    def report(self, event: LineEvent) -> None:
        """What the worker reports goes to the hub."""
        super().report(event)
        if not isinstance(event, LineMeasured | StationMeasured):
            self._hub.apply(event)

    def take(self, topic: str, payload: str, *, retain: bool = False, late_s: float = 0.0) -> None:
        """A message arrives at T, `late_s` after the client had it."""
        target = self._topics.parse(f"wisco/{topic}")
        assert isinstance(target, CommandTarget)
        received = Received(f"wisco/{topic}", payload.encode(), retain=retain, at=T - late_s)
        self.line.at(T, lambda: self.intake.receive(target, received, self.line.now))

    def results(self) -> list[dict[str, Any]]:
        """Runs to the end, and gives every verdict that was published."""
        if self.pings:
            prove(self.link, self.line.now)
        for second in range(100, 112):
            self.line.at(second, self._ping)
        self.run(END)
        broker = FakeConnection()
        self._outbox.connected([], self.line.now)
        self._outbox.pump(broker.publish, self.line.now)
        return [json.loads(p) for topic, p in broker.pairs() if topic == "wisco/s1/result"]

    def _ping(self) -> None:
        payload = self.link.ping(self.line.now)
        if self.pings and payload is not None:
            self.link.seen(payload, self.line.now)


ONE = "s1/do/1/set"


def _done(bridge: Bridge) -> None:
    bridge.take(ONE, "ON")


def _retained(bridge: Bridge) -> None:
    bridge.take(ONE, "ON", retain=True)


def _expired(bridge: Bridge) -> None:
    bridge.take(ONE, "ON", late_s=2.1)


def _stale_link(bridge: Bridge) -> None:
    bridge.pings = False
    bridge.take(ONE, "ON")


def _duplicate(bridge: Bridge) -> None:
    bridge.take(ONE, '{"state": "OFF", "id": "x1"}')
    bridge.take("s1/do/4/set", '{"state": "ON", "id": "x1"}')


def _superseded(bridge: Bridge) -> None:
    bridge.take(ONE, "ON")
    bridge.take(ONE, "OFF")


def _bad_payload(bridge: Bridge) -> None:
    bridge.take(ONE, "on")


def _no_such_channel(bridge: Bridge) -> None:
    bridge.take("s1/do/9/set", "ON")


def _read_only(bridge: Bridge) -> None:
    bridge.take("s1/do/8/set", "ON")


def _busy(bridge: Bridge) -> None:
    module = bridge.line.modules[1]
    module.set_mode(4, pulse=True, hold_s=20.0)
    bridge.line.at(T - 1, lambda: module.set_output(4, True))
    bridge.take("s1/set", '{"do": {"3": "ON", "5": "ON"}}')


def _rate_limited(bridge: Bridge) -> None:
    for channel in range(3, 7):
        bridge.take(f"s1/do/{channel}/set", "TOGGLE")


def _interlock(bridge: Bridge) -> None:
    bridge.line.modules[1].set_output(2, True)
    bridge.take(ONE, "ON")


def _wrong_model(bridge: Bridge) -> None:
    bridge.line.modules[1] = SimulatedModule(DO100, 1, clock=bridge.line.clock)
    bridge.take(ONE, "ON")


def _offline(bridge: Bridge) -> None:
    bridge.line.modules[1].away = True
    bridge.take(ONE, "ON")


def _stopping(bridge: Bridge) -> None:
    bridge.intake.stopping = True
    bridge.take(ONE, "ON")


def _failed_no_reply(bridge: Bridge) -> None:
    bridge.line.fault = lambda _: Fault.LOSE_REPLY if bridge.line.now >= T - 0.05 else None
    bridge.take(ONE, "TOGGLE")


def _unknown_no_reply(bridge: Bridge) -> None:
    bridge.fault_from_first_write(Fault.LOSE_REPLY, Fault.LOSE_REPLY)
    bridge.take(ONE, "ON")


def _module_refused(bridge: Bridge) -> None:
    bridge.fault_on_writes(Fault.REFUSE)
    bridge.take(ONE, "ON")


def _not_confirmed(bridge: Bridge) -> None:
    bridge.fault_on_writes(Fault.IGNORE, Fault.IGNORE)
    bridge.take(ONE, "ON")


def _failed_port_down(bridge: Bridge) -> None:
    bridge.line.at(T, lambda: setattr(bridge.line, "fault", lambda _: Fault.PORT_GONE))
    bridge.take(ONE, "TOGGLE")


def _unknown_port_down(bridge: Bridge) -> None:
    bridge.fault_on_writes(Fault.PORT_GONE_AFTER)
    bridge.take(ONE, "ON")


@dataclass(frozen=True)
class Scenario:
    """What happens, and how one command ends; `others`: how the others end, in their order."""

    status: Status
    reason: Reason | None
    happens: Callable[[Bridge], None]
    writes: int = 0  # frames that switch something
    others: tuple[Status, ...] = ()
    code: int | None = None

    def __str__(self) -> str:
        return f"{self.status}-{self.reason}"


SCENARIOS = [
    Scenario(Status.DONE, None, _done, writes=1),
    Scenario(Status.FAILED, Reason.NO_REPLY, _failed_no_reply),
    Scenario(Status.FAILED, Reason.MODULE_REFUSED, _module_refused, writes=1, code=4),
    Scenario(Status.FAILED, Reason.NOT_CONFIRMED, _not_confirmed, writes=2),
    Scenario(Status.FAILED, Reason.PORT_DOWN, _failed_port_down),
    Scenario(Status.REFUSED, Reason.RETAINED, _retained),
    Scenario(Status.REFUSED, Reason.EXPIRED, _expired),
    Scenario(Status.REFUSED, Reason.STALE_LINK, _stale_link),
    Scenario(Status.REFUSED, Reason.DUPLICATE, _duplicate, writes=1, others=(Status.DONE,)),
    Scenario(Status.REFUSED, Reason.SUPERSEDED, _superseded, writes=1, others=(Status.DONE,)),
    Scenario(Status.REFUSED, Reason.BAD_PAYLOAD, _bad_payload),
    Scenario(Status.REFUSED, Reason.NO_SUCH_CHANNEL, _no_such_channel),
    Scenario(Status.REFUSED, Reason.READ_ONLY, _read_only),
    Scenario(Status.REFUSED, Reason.BUSY, _busy),
    Scenario(
        Status.REFUSED, Reason.RATE_LIMITED, _rate_limited, writes=3, others=(Status.DONE,) * 3
    ),
    Scenario(Status.REFUSED, Reason.INTERLOCK, _interlock),
    Scenario(Status.REFUSED, Reason.WRONG_MODEL, _wrong_model),
    Scenario(Status.REFUSED, Reason.OFFLINE, _offline),
    Scenario(Status.REFUSED, Reason.STOPPING, _stopping),
    Scenario(Status.UNKNOWN, Reason.NO_REPLY, _unknown_no_reply, writes=1),
    Scenario(Status.UNKNOWN, Reason.PORT_DOWN, _unknown_port_down, writes=1),
]


@pytest.mark.parametrize("scenario", SCENARIOS, ids=str)
def test_each_way_that_a_command_can_end(scenario: Scenario) -> None:
    """Each command gets one verdict, with this status and reason; refused ones send nothing."""
    bridge = Bridge()
    scenario.happens(bridge)
    results = bridge.results()
    (found,) = [r for r in results if r.get("reason") == scenario.reason]
    assert found["status"] == scenario.status
    assert found.get("code") == scenario.code
    assert tuple(r["status"] for r in results if r is not found) == scenario.others
    assert len(bridge.writes()) == scenario.writes


def test_no_status_and_no_reason_is_left_out() -> None:
    """The table of docs/contract.md, word by word: whoever adds a reason adds its scenario."""
    assert {scenario.status for scenario in SCENARIOS} == set(Status)
    assert {scenario.reason for scenario in SCENARIOS} == {None, *Reason}
