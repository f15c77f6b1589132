"""Interlocked outputs: the rule by itself, and on the wire of each protocol."""

import logging
from dataclasses import replace
from functools import partial

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.line.rules.interlock import Interlock
from bridge.model import LineProtocol, Reason, Status, Verdict, Word, Writes
from bridge.simulator.faults import is_write

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 103.0
END = T + 8.0
DEAD_S = 0.5
UP, DOWN, LAMP = 0b0001, 0b0100, 0b1000  # with a gap, that Modbus range writes carry

PROTOCOLS = [
    (LineProtocol.WISCO, Writes.WISCO),
    (LineProtocol.WISCO, Writes.AUTO),
    (LineProtocol.MODBUS_RTU, Writes.AUTO),
    (LineProtocol.MODBUS_ASCII, Writes.AUTO),
]
every_protocol = pytest.mark.parametrize(("protocol", "writes"), PROTOCOLS)


def _worker(
    protocol: LineProtocol = LineProtocol.MODBUS_RTU,
    writes: Writes = Writes.AUTO,
    *,
    dead_s: float = DEAD_S,
    pulse_s: float | None = None,
) -> VirtualWorker:
    config = replace(make_station(), interlock=(UP | DOWN,), interlock_dead_s=dead_s)
    worker = VirtualWorker(make_line(config, protocol=protocol, writes=writes))
    if pulse_s is not None:
        for output in (1, 3):
            worker.line.modules[1].set_mode(output, pulse=True, hold_s=pulse_s)
    return worker


def _judged(worker: VirtualWorker) -> list[tuple[Status, Reason | None]]:
    return [(verdict.status, verdict.reason) for verdict in worker.verdicts()]


def _refused_once(worker: VirtualWorker) -> Verdict:
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason) == (Status.REFUSED, Reason.INTERLOCK)
    assert worker.writes() == []
    return verdict


REFUSED = (Status.REFUSED, Reason.INTERLOCK)
DONE = (Status.DONE, None)


# --- on the wire ----------------------------------------------------------------------------------


@every_protocol
@pytest.mark.parametrize("word", [None, Word.TOGGLE, Word.PRESS])
def test_no_second_output_goes_on(
    protocol: LineProtocol, writes: Writes, word: Word | None
) -> None:
    """ON, TOGGLE and PRESS while the other is ON: refused, nothing is written."""
    worker = _worker(protocol, writes)
    worker.line.modules[1].set_output(1, True)
    worker.command_at(T, DOWN, 0 if word is Word.TOGGLE else DOWN, word=word)
    worker.run(END)
    assert _refused_once(worker).detail == (
        "output 3 is interlocked with output 1, ON now: switch OFF first, then wait 0.5 s"
    )
    assert worker.line.modules[1].outputs == UP


@every_protocol
@pytest.mark.parametrize("on", [True, False])
def test_what_somebody_else_switched_just_now_counts(
    protocol: LineProtocol, writes: Writes, on: bool
) -> None:
    """The read right before the write finds it ON; or finds it OFF, and the dead time begins."""
    worker = _worker(protocol, writes)
    module = worker.line.modules[1]
    module.set_output(1, not on)
    worker.line.at(T - 0.001, lambda: module.set_output(1, on))
    worker.command_at(T, DOWN, DOWN)
    worker.run(END)
    _refused_once(worker)


@every_protocol
def test_two_at_once_are_refused_unread(protocol: LineProtocol, writes: Writes) -> None:
    """`B/S/set` that asks for both: no frame is needed to say no."""
    worker = _worker(protocol, writes)
    worker.command_at(T, UP | DOWN | LAMP, UP | DOWN | LAMP)
    worker.run(END)
    assert _refused_once(worker).detail == (
        "outputs 1 and 3 are interlocked: only one of them may be ON at once"
    )


@every_protocol
@pytest.mark.parametrize("dead_s", [0.0, DEAD_S])
def test_one_off_and_another_on_in_one_frame_is_refused(
    protocol: LineProtocol, writes: Writes, dead_s: float
) -> None:
    """Between the two there is no time at all."""
    worker = _worker(protocol, writes, dead_s=dead_s)
    worker.line.modules[1].set_output(1, True)
    worker.command_at(T, UP | DOWN, DOWN)
    worker.run(END)
    detail = _refused_once(worker).detail
    assert detail is not None
    assert "output 1, which would go OFF only in the same write" in detail


@every_protocol
def test_the_dead_time_runs_from_our_off(protocol: LineProtocol, writes: Writes) -> None:
    """Refused with how long to wait; after that wait it is done."""
    worker = _worker(protocol, writes)
    worker.line.modules[1].set_output(1, True)
    worker.command_at(T, UP, 0)
    worker.command_at(T + 0.3, DOWN, DOWN)
    worker.command_at(T + 0.9, DOWN, DOWN)
    worker.run(END)
    assert _judged(worker) == [DONE, REFUSED, DONE]
    detail = worker.verdicts()[1].detail
    assert detail is not None
    assert detail.startswith("output 3 is interlocked with output 1, which may have been ON until")
    assert 0.2 < float(detail.removesuffix(" s").rsplit(" ", 1)[1]) <= 0.6
    switchings = {(s.output, s.value): s.at for s in worker.line.modules[1].switchings}
    assert switchings[3, True] - switchings[1, False] >= DEAD_S


@every_protocol
def test_a_dead_time_of_zero_takes_a_read_that_sees_it_off(
    protocol: LineProtocol, writes: Writes
) -> None:
    """Two commands one after the other are done."""
    worker = _worker(protocol, writes, dead_s=0.0)
    worker.line.modules[1].set_output(1, True)
    worker.command_at(T, UP, 0)
    worker.command_at(T, DOWN, DOWN)
    worker.run(END)
    assert _judged(worker) == [DONE, DONE]


@every_protocol
def test_a_pulse_counts_while_it_runs_and_the_dead_time_after(
    protocol: LineProtocol, writes: Writes
) -> None:
    """A PRESS of the other waits until the pulse was found to be over, and the dead time more."""
    worker = _worker(protocol, writes, pulse_s=1.0)
    worker.command_at(T, UP, UP, word=Word.PRESS)
    worker.command_at(T + 0.3, DOWN, DOWN, word=Word.PRESS)
    worker.command_at(T + 1.1, DOWN, DOWN, word=Word.PRESS)
    worker.command_at(T + 4.0, DOWN, DOWN, word=Word.PRESS)
    worker.run(END)
    assert _judged(worker) == [DONE, REFUSED, REFUSED, DONE]


@every_protocol
def test_a_pulse_that_no_read_saw_counts(protocol: LineProtocol, writes: Writes) -> None:
    """A slow line, a short pulse: it was over before it could be read, but it was ordered."""
    worker = _worker(protocol, writes, pulse_s=0.1, dead_s=2.0)
    worker.line.baud = 1200
    worker.command_at(T, UP, UP, word=Word.PRESS)
    worker.command_at(T + 0.2, DOWN, DOWN, word=Word.PRESS, deadline_s=4.0)
    worker.command_at(T + 5.0, DOWN, DOWN, word=Word.PRESS)
    worker.run(END)
    assert worker.verdicts()[0].seen_on is False
    assert _judged(worker) == [DONE, REFUSED, DONE]


@every_protocol
def test_an_on_that_may_have_arrived_counts(protocol: LineProtocol, writes: Writes) -> None:
    """After an ON with a lost reply the dead time begins with a read that finds OFF."""
    worker = _worker(protocol, writes, pulse_s=0.1)
    until = [float("inf")]

    def fault(frame: bytes) -> Fault | None:
        if is_write(frame) and until == [float("inf")]:
            until[0] = worker.line.now + 1.0
        return Fault.LOSE_REPLY if T <= until[0] - 1.0 <= worker.line.now < until[0] else None

    worker.line.fault = fault
    worker.command_at(T, UP, UP, word=Word.PRESS)
    worker.command_at(T + 1.3, DOWN, DOWN, word=Word.PRESS)
    worker.command_at(T + 6.0, DOWN, DOWN, word=Word.PRESS)
    worker.run(END)
    assert _judged(worker) == [(Status.UNKNOWN, Reason.NO_REPLY), REFUSED, DONE]


@every_protocol
def test_off_is_always_allowed(protocol: LineProtocol, writes: Writes) -> None:
    """OFF is allowed, also while both outputs are ON."""
    worker = _worker(protocol, writes)
    module = worker.line.modules[1]
    module.set_output(1, True)
    module.set_output(3, True)
    worker.command_at(T, DOWN, 0)
    worker.run(END)
    assert _judged(worker) == [DONE]
    assert module.outputs == UP


@every_protocol
@pytest.mark.parametrize("outage", [Fault.LOSE_REPLY, Fault.PORT_GONE], ids=lambda f: f.name)
def test_a_module_that_was_just_met_waits_the_dead_time(
    protocol: LineProtocol, writes: Writes, outage: Fault
) -> None:
    """After a start, an absence, or a port that was gone: who knows what was ON a moment ago."""
    worker = _worker(protocol, writes, dead_s=10.0)
    worker.line.fault = lambda _: outage if 115.0 <= worker.line.now < 120.0 else None
    worker.command_at(109.0, UP, UP)  # met at 100
    worker.command_at(111.0, UP, UP)
    worker.command_at(112.0, UP, 0)
    worker.command_at(127.0, DOWN, DOWN)  # OFF for more than 10 s, but met at 120
    worker.command_at(138.0, DOWN, DOWN)
    worker.run(140.0)
    assert _judged(worker) == [REFUSED, DONE, DONE, REFUSED, DONE]


@every_protocol
def test_without_a_fresh_read_nothing_is_sent(protocol: LineProtocol, writes: Writes) -> None:
    """`failed` / `no_reply`, as for a TOGGLE that cannot read."""
    worker = _worker(protocol, writes)
    worker.line.fault = lambda _: Fault.LOSE_REPLY if worker.line.now >= T - 0.1 else None
    worker.command_at(T, DOWN, DOWN)
    worker.run(END)
    assert _judged(worker) == [(Status.FAILED, Reason.NO_REPLY)]
    assert worker.writes() == []


@pytest.mark.parametrize("protocol", [LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII])
def test_a_repeat_looks_again(protocol: LineProtocol) -> None:
    """The other went ON meanwhile: the lost write is not sent again, and the verdict says why."""
    worker = _worker(protocol)
    begun: list[float] = []

    def fault(frame: bytes) -> Fault | None:
        if begun or not is_write(frame):
            return None
        begun.append(worker.line.now)
        worker.line.at(worker.line.now + 0.001, lambda: module.set_output(1, True))
        return Fault.LOSE_REQUEST

    module = worker.line.modules[1]
    worker.line.fault = fault
    worker.command_at(T, DOWN, DOWN)
    worker.run(END)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert verdict.detail is not None
    assert "output 1, ON now" in verdict.detail
    assert len(worker.writes()) == 1
    assert module.outputs == UP


def test_a_repeat_without_hindrance_is_made() -> None:
    """The interlock costs no repeat that is safe."""
    worker = _worker()
    worker.fault_on_writes(Fault.LOSE_REQUEST)
    worker.command_at(T, DOWN, DOWN)
    worker.run(END)
    assert _judged(worker) == [DONE]
    assert len(worker.writes()) == 2


@every_protocol
def test_other_outputs_pay_nothing(protocol: LineProtocol, writes: Writes) -> None:
    """A command to an output in no group, or OFF to any, takes the frames that it always took."""
    for mask, values in ((LAMP, LAMP), (UP, 0)):
        frames = []
        for interlock in ((), (UP | DOWN,)):
            config = replace(make_station(), interlock=interlock)
            worker = VirtualWorker(make_line(config, protocol=protocol, writes=writes))
            worker.command_at(T, mask, values)
            worker.run(T + 2)
            (at,) = [at for at, event in worker.events if isinstance(event, Verdict)]
            frames.append([frame for sent, frame in worker.line.wire if T <= sent <= at])
        assert frames[0] == frames[1]


@every_protocol
def test_two_that_somebody_else_switched_on_are_told_once(
    protocol: LineProtocol, writes: Writes, caplog: pytest.LogCaptureFixture
) -> None:
    """One warning a transition, and nothing is switched."""
    worker = _worker(protocol, writes)
    module = worker.line.modules[1]
    for at, output, value in (
        (105.0, 1, True), (105.0, 3, True), (110.0, 8, True),
        (115.0, 3, False), (120.0, 3, True),
    ):  # fmt: skip
        worker.line.at(at, partial(module.set_output, output, value))
    with caplog.at_level(logging.WARNING):
        worker.run(125.0)
    told = [r.getMessage() for r in caplog.records if "interlocked" in r.getMessage()]
    assert told == ["line main station 1 (s1): outputs 1 and 3 are interlocked and ON at once"] * 2
    assert worker.writes() == []


# --- the rule by itself ---------------------------------------------------------------------------


def test_groups_do_not_mind_each_other() -> None:
    """Groups are independent: an ON in one does not affect another."""
    interlock = Interlock((0b0011, 0b1100), DEAD_S)
    interlock.met(0b0001, 100.0)
    assert interlock.objection(0b0100, 0b0100, 0b0001, 101.0) is None
    assert interlock.objection(0b0110, 0b0110, 0b0001, 101.0) is not None


def test_of_three_only_one() -> None:
    """The one that was ON last decides how long to wait."""
    interlock = Interlock((0b0111,), 2.0)
    interlock.met(0b0110, 100.0)
    interlock.observe(0b0100, 101.0)
    interlock.observe(0, 102.0)
    assert interlock.objection(1, 1, 0, 103.0) == (
        "output 1 is interlocked with output 3, which may have been ON until just now: wait 1.0 s"
    )
    assert interlock.wait_s(1, 103.0) == pytest.approx(1.0)
    assert interlock.objection(1, 1, 0, 104.0) is None


def test_an_output_may_go_on_again_itself() -> None:
    """An output may go ON again itself without a dead time."""
    interlock = Interlock((0b0011,), DEAD_S)
    interlock.met(0b0001, 100.0)
    interlock.observe(0, 101.0)
    assert interlock.objection(1, 1, 0, 101.0) is None
    assert interlock.objection(2, 2, 0, 101.0) is not None
