"""Local rules in the thread of a line, on a virtual line."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from support.covers import SHUTTER, cover_station
from support.rules import rule
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import GestureConfig, InputConfig, LineConfig, OutputConfig, RuleConfig
from bridge.line.forecast import forecast
from bridge.model import (
    DIO100,
    DO100,
    LineProtocol,
    Reason,
    RuleDue,
    RuleFired,
    StationChanged,
    Status,
    Verdict,
)
from bridge.simulator.faults import is_write

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 102.0
PRESSED = rule("s1/di/3", "ON", {"s1/do/2": "ON"})
PROTOCOLS = list(LineProtocol)
BUTTON = InputConfig(3, gestures=GestureConfig(double_s=0.0))
INPUTS = tuple(BUTTON if n == 3 else InputConfig(n) for n in range(1, 17))


def worker_with(
    *rules: RuleConfig,
    line: LineConfig | None = None,
    protocol: LineProtocol = LineProtocol.MODBUS_RTU,
    away: bool = False,
) -> VirtualWorker:
    """A worker that follows rules; of two modules if nothing else is said."""
    stations = make_station(1, DIO100, inputs=INPUTS), make_station(2, DIO100)
    worker = VirtualWorker(line or make_line(*stations, protocol=protocol))
    worker.worker.rules(rules)
    worker.worker.broker(100.0 if away else None)
    return worker


def set_at(
    worker: VirtualWorker, instant: float, channel: int, value: bool, address: int = 1
) -> None:
    """Set an input at an instant."""
    module = worker.line.modules[address]
    worker.line.at(instant, lambda: module.set_input(channel, value))


def fired(worker: VirtualWorker) -> list[RuleFired]:
    """Return what was told of rules."""
    return [event for _, event in worker.events if isinstance(event, RuleFired)]


def written_at(worker: VirtualWorker) -> list[float]:
    """Return when frames that switch went out."""
    return [at for at, frame in worker.line.wire if is_write(frame)]


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("word", ["ON", "TOGGLE"])
def test_a_change_is_answered_within_the_bound_and_two_exchanges(
    protocol: LineProtocol, word: str
) -> None:
    """The write is on the wire, and its verdict names the rule."""
    line = make_line(*(make_station(n) for n in range(1, 6)), protocol=protocol)
    worker = worker_with(rule("s1/di/3", "ON", {"s4/do/2": word}), line=line)
    set_at(worker, T, 3, True)
    worker.run(T + 2.0)

    plan = forecast(line)
    [at] = written_at(worker)
    assert at - T <= plan.inputs_s["s1"] + 2 * (plan.exchange_s + 0.01)
    verdict = worker.verdict()
    assert (verdict.status, verdict.by, verdict.payload) == (Status.DONE, "rule Stairs", word)
    assert worker.line.modules[4].outputs == 0b10
    assert fired(worker) == [RuleFired("stairs")]


@pytest.mark.parametrize(
    ("event", "presses", "times"),
    [("short", [0.2], 1), ("long", [0.2], 0), ("long", [1.2], 1), ("OFF", [0.2, 0.3], 2)],
)
def test_presses_are_those_that_are_published(event: str, presses: list[float], times: int) -> None:
    """The same recogniser decides."""
    worker = worker_with(rule("s1/di/3", event, {"s1/do/2": "TOGGLE"}))
    at = T
    for held_s in presses:
        set_at(worker, at, 3, True)
        set_at(worker, at + held_s, 3, False)
        at += 2.0
    worker.run(at + 1.0)
    assert len(worker.verdicts()) == len(fired(worker)) == times


def _nothing(_worker: VirtualWorker) -> None:
    """The first contact."""


def _port_lost(worker: VirtualWorker) -> None:
    def gone(_frame: bytes) -> Fault:
        worker.line.fault = lambda _: None
        return Fault.PORT_GONE

    worker.line.at(T - 0.05, lambda: setattr(worker.line, "fault", gone))


def _module_away(worker: VirtualWorker) -> None:
    module = worker.line.modules[1]
    worker.line.at(T - 0.05, lambda: setattr(module, "away", True))
    worker.line.at(T + 8.0, lambda: setattr(module, "away", False))


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize(
    ("how", "at"), [(_nothing, 99.9), (_port_lost, T), (_module_away, T + 1.0)]
)
def test_a_first_read_fires_nothing(
    protocol: LineProtocol, how: Callable[[VirtualWorker], None], at: float
) -> None:
    """After a contact, a reopened port, an absence: what changed meanwhile is no event."""
    worker = worker_with(PRESSED, protocol=protocol)
    if at < 100.0:
        worker.line.modules[1].set_input(3, True)
    else:
        set_at(worker, at, 3, True)
    how(worker)
    worker.run(T + 20.0)
    assert worker.writes() == []
    assert fired(worker) == []
    assert any(isinstance(e, StationChanged) and e.online for e in worker.reported())


def test_a_value_that_one_unprotected_read_showed_fires_nothing() -> None:
    """A bit that flipped on the wire is no press: it takes two equal reads."""
    rules = [rule(f"s1/di/{n}", "ON", {"s1/do/2": "ON"}) for n in range(1, 17)]
    worker = worker_with(*rules, protocol=LineProtocol.WISCO)
    flipped = False

    def flip(frame: bytes) -> Fault | None:
        nonlocal flipped
        if worker.line.now > T and not flipped and frame.startswith(b"#01") and b"DI" in frame:
            flipped = True
            return Fault.FLIP_REPLY
        return None

    worker.line.fault = flip
    worker.run(T + 5.0)
    assert flipped
    assert worker.writes() == []


def test_what_may_have_happened_over_two_seconds_ago_fires_nothing() -> None:
    """The module did not answer for 2.5 s, and was not offline yet."""
    worker = worker_with(PRESSED)
    lost_from, lost_until = T, T + 2.5
    worker.line.fault = lambda frame: (
        Fault.LOSE_REPLY if lost_from < worker.line.now < lost_until and frame[0] == 1 else None
    )
    set_at(worker, T + 0.1, 3, True)
    set_at(worker, T + 20.0, 3, False)
    set_at(worker, T + 22.0, 3, True)
    worker.run(T + 25.0)
    late = [at for at in written_at(worker) if at < T + 20.0]
    assert late == []
    assert len(written_at(worker)) == 1  # the later one fires as ever
    assert fired(worker) == [RuleFired("stairs")]


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("phase_s", [n / 125 for n in range(8)])
def test_a_press_just_before_a_suspend_fires_nothing(
    protocol: LineProtocol, phase_s: float
) -> None:
    """Also if a read was under way: its value may be from before the suspend."""
    worker = worker_with(PRESSED, protocol=protocol)

    def press_and_sleep() -> None:
        worker.line.modules[1].set_input(3, True)
        worker.line.now += 5.0

    worker.line.at(T + phase_s, press_and_sleep)
    worker.run(T + 10.0)
    assert fired(worker) == []
    assert worker.writes() == []


def test_orders_that_wait_too_long_are_refused_with_a_verdict() -> None:
    """The deadline counts from the last read before the change."""
    worker = worker_with(PRESSED)
    set_at(worker, T, 3, True)
    held_up = False

    def suspend() -> None:
        nonlocal held_up
        if not held_up and fired(worker):
            held_up = True
            worker.line.now += 30.0

    original = worker.worker._emit

    def emit(event: object) -> None:
        original(event)  # type: ignore[arg-type]
        suspend()

    worker.worker._automation._emit = emit
    worker.run(T + 40.0)
    assert held_up
    assert worker.writes() == []
    assert worker.verdict().reason is Reason.EXPIRED


def test_a_condition_holds_a_rule() -> None:
    """And says why; it is judged when the event is seen."""
    held = rule("s1/di/3", "ON", {"s1/do/2": "ON"}, conditions={"s2/di/6": "OFF"})
    worker = worker_with(held)
    for at, value in ((T, True), (T + 1, False), (T + 2, True)):
        set_at(worker, at, 3, value)
    set_at(worker, T - 1.0, 6, True, address=2)
    set_at(worker, T + 1.5, 6, False, address=2)
    worker.run(T + 5.0)
    assert fired(worker) == [RuleFired("stairs", "s2/di/6 is ON"), RuleFired("stairs")]
    assert len(worker.writes()) == 1


def test_a_condition_that_is_not_known_holds_a_rule() -> None:
    """The module of a safety input is silent: the gate stays."""
    held = rule("s1/di/3", "ON", {"s1/do/2": "ON"}, conditions={"s2/di/6": "OFF"})
    worker = worker_with(held)
    worker.line.at(T, lambda: setattr(worker.line.modules[2], "away", True))
    set_at(worker, T + 1.0, 3, True)
    worker.run(T + 5.0)
    [told] = fired(worker)
    assert told.held is not None
    assert told.held.startswith("s2/di/6 is not known")
    assert worker.writes() == []


def test_a_rule_for_an_absence_of_the_broker_acts_only_then() -> None:
    """When the broker is back nothing is switched."""
    worker = worker_with(replace(PRESSED, broker_away=True), away=True)
    for at, value in ((T, True), (T + 1, False), (T + 3, True)):
        set_at(worker, at, 3, value)
    worker.line.at(T + 2.0, lambda: worker.worker.broker(None))
    worker.run(T + 5.0)
    [at] = written_at(worker)
    assert at < T + 1.0
    assert worker.line.modules[1].outputs == 0b10


def test_the_rules_can_be_exchanged_while_the_line_works() -> None:
    """A rule that is switched off acts no more; no contact is needed."""
    worker = worker_with(PRESSED)
    worker.line.at(T - 1.0, lambda: worker.worker.rules([]))
    set_at(worker, T, 3, True)
    set_at(worker, T + 1.0, 3, False)
    worker.line.at(T + 1.5, lambda: worker.worker.rules([PRESSED]))
    set_at(worker, T + 2.0, 3, True)
    worker.run(T + 5.0)
    [at] = written_at(worker)
    assert at > T + 2.0


def test_orders_for_one_station_go_out_in_one_write() -> None:
    """They are merged as commands are; each has its verdict."""
    scene = rule("s1/di/3", "ON", {"s2/do/1": "ON", "s2/do/2": "OFF", "s2/do/3": "ON"})
    worker = worker_with(scene)
    set_at(worker, T, 3, True)
    worker.run(T + 2.0)
    assert len(worker.writes()) == 1
    assert [verdict.target for verdict in worker.verdicts()] == ["do/1", "do/2", "do/3"]
    assert worker.line.modules[2].outputs == 0b101


@pytest.mark.parametrize("fault", [Fault.LOSE_REPLY, Fault.GARBLE_REPLY, Fault.LOSE_REQUEST])
def test_a_pulse_is_sent_once(fault: Fault) -> None:
    """Also by a rule, whatever becomes of its reply."""
    outputs = (OutputConfig(1, mode="pulse"), OutputConfig(2))
    config = make_station(1, DIO100, outputs=outputs)
    worker = worker_with(rule("s1/di/3", "ON", {"s1/do/1": "PRESS"}), line=make_line(config))
    worker.line.modules[1].set_mode(1, pulse=True, hold_s=0.5)
    worker.fault_on_writes(fault)
    set_at(worker, T, 3, True)
    worker.run(T + 5.0)
    assert len(worker.writes()) == 1
    assert worker.verdict().by == "rule Stairs"


def test_the_interlock_holds_for_rules() -> None:
    """The second direction is refused while the first is ON."""
    config = replace(make_station(1), interlock=(0b11,))
    rules = [
        rule("s1/di/3", "ON", {"s1/do/1": "ON"}, name="Up"),
        rule("s1/di/4", "ON", {"s1/do/2": "ON"}, name="Down"),
    ]
    worker = worker_with(*rules, line=make_line(config))
    set_at(worker, T, 3, True)
    set_at(worker, T + 1.0, 4, True)
    worker.run(T + 3.0)
    up, down = worker.verdicts()
    assert (up.status, up.by) == (Status.DONE, "rule Up")
    assert (down.reason, down.by) == (Reason.INTERLOCK, "rule Down")
    assert worker.line.modules[1].outputs == 0b01


def test_a_cover_is_commanded() -> None:
    """It opens, and a second input stops it."""
    config = cover_station(make_station(1, DIO100))
    covers = {SHUTTER.id: SHUTTER.outputs}
    target = f"s1/cover/{SHUTTER.id}"
    rules = [
        rule("s1/di/3", "ON", {target: "OPEN"}, covers=covers, name="Up"),
        rule("s1/di/4", "ON", {target: "STOP"}, covers=covers, name="Halt"),
    ]
    worker = worker_with(*rules, line=make_line(config))
    set_at(worker, T, 3, True)
    set_at(worker, T + 1.0, 4, True)
    worker.run(T + 3.0)
    told = [(verdict.status, verdict.by) for verdict in worker.verdicts()]
    assert told == [(Status.DONE, "rule Up"), (Status.DONE, "rule Halt")]
    assert worker.line.modules[1].outputs == 0


def test_orders_for_an_offline_module_are_refused() -> None:
    """With a verdict that names the rule."""
    worker = worker_with(rule("s1/di/3", "ON", {"s2/do/1": "ON"}))
    worker.line.modules[2].away = True
    set_at(worker, T + 5.0, 3, True)
    worker.run(T + 8.0)
    assert (worker.verdict().reason, worker.verdict().by) == (Reason.OFFLINE, "rule Stairs")


def test_a_rule_with_parts_elsewhere_goes_to_the_main_thread() -> None:
    """With the instants between which it may be carried out."""
    worker = worker_with(rule("s1/di/3", "ON", {"hall/do/1": "ON"}))
    set_at(worker, T, 3, True)
    worker.run(T + 2.0)
    [due] = [event for event in worker.reported() if isinstance(event, RuleDue)]
    assert due.rule == "stairs"
    assert due.trigger == ("s1", 3, "ON")
    assert T < due.seen_at < T + 0.5
    assert due.deadline - 2.0 <= T
    assert worker.writes() == []
    assert fired(worker) == []


def test_a_stop_refuses_what_a_rule_ordered_just_now() -> None:
    """Each order has its verdict."""
    stations = make_station(1, DIO100), make_station(2, DO100)
    worker = worker_with(PRESSED, line=make_line(*stations))
    set_at(worker, T, 3, True)
    original = worker.report

    def report(event: object) -> None:
        original(event)  # type: ignore[arg-type]
        if isinstance(event, RuleFired):
            worker.worker.stop()

    worker.worker._automation._emit = report
    worker.run(T + 2.0)
    verdicts = [event for event in worker.reported() if isinstance(event, Verdict)]
    assert [one.reason for one in verdicts] == [Reason.STOPPING]
