"""`max_on` and `on_loss` through the line worker: what goes out, and when, on a virtual clock."""

import logging
from collections import Counter
from dataclasses import replace
from functools import partial

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import OnLossConfig, OutputConfig
from bridge.model import DO100, LineProtocol, Reason, Status, Verdict, Word, Writes
from bridge.simulator.faults import is_write

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 103.0
OUTPUT = 3
AFTER_S = 5.0  # of a loss of the broker
PROTOCOLS = list(LineProtocol)


def _worker(
    *outputs: OutputConfig,
    interlock: tuple[int, ...] = (),
    protocol: LineProtocol = LineProtocol.WISCO,
    writes: Writes = Writes.AUTO,
) -> VirtualWorker:
    config = replace(make_station(outputs=outputs), interlock=interlock)
    return VirtualWorker(make_line(config, protocol=protocol, writes=writes))


def _limited(protocol: LineProtocol = LineProtocol.WISCO) -> VirtualWorker:
    return _worker(OutputConfig(OUTPUT, max_on_s=20.0), protocol=protocol)


def _guarded(*, on: bool, writes: Writes = Writes.AUTO) -> VirtualWorker:
    return _worker(OutputConfig(OUTPUT, on_loss=OnLossConfig(AFTER_S, on=on)), writes=writes)


def _loses_broker(worker: VirtualWorker, at: float, until: float | None = None) -> None:
    worker.line.at(at, lambda: worker.worker.broker(at))
    if until is not None:
        worker.line.at(until, lambda: worker.worker.broker(None))


def _orders(worker: VirtualWorker, output: int = OUTPUT) -> list[tuple[float, bool]]:
    """Return the orders of frames to one output, with their instants."""
    switchings = worker.line.modules[1].switchings
    return [(s.at, s.value) for s in switchings if s.frame and s.output == output]


# --- max_on ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_an_output_goes_off_when_it_was_on_for_max_on(protocol: LineProtocol) -> None:
    """After `max_on` the output is switched OFF once, read back, and reported with `by`."""
    worker = _limited(protocol)
    worker.command_at(T, 4, 4)
    worker.run(T + 60)
    (on_at, _), (off_at, off) = _orders(worker)
    assert not off
    assert 20.0 <= off_at - on_at <= 20.5
    ordered, own = worker.verdicts()
    assert (ordered.status, ordered.by) == (Status.DONE, None)
    assert (own.target, own.payload, own.status, own.by) == ("do/3", "OFF", Status.DONE, "max_on")
    assert own.detail == "it was ON for 20 s"


def test_somebody_elses_on_counts_from_when_it_was_seen() -> None:
    """A hand switched it: within the sweep of the outputs it is seen."""
    worker = _limited()
    worker.line.at(T, lambda: worker.line.modules[1].set_output(OUTPUT, True))
    worker.run(T + 60)
    ((off_at, off),) = _orders(worker)
    assert not off
    assert 20.0 <= off_at - T <= 23.0


def test_on_again_at_once_has_its_whole_time() -> None:
    """OFF and ON between two reads are two commands all the same."""
    worker = _limited()
    worker.command_at(T, 4, 4)
    worker.command_at(T + 19, 4, 0)
    worker.command_at(T + 19, 4, 4, word=None, command_id="again")
    worker.command_at(T + 19.2, 4, 0)
    worker.command_at(T + 19.2, 8, 0)
    worker.command_at(T + 19.3, 4, 4)
    worker.run(T + 60)
    off_at = _orders(worker)[-1][0]
    assert 39.3 <= off_at - T <= 40.0


def test_a_module_that_does_not_obey_is_told_again_and_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """After pauses that grow, each a new order; one line when it fails, one when it is done."""
    worker = _limited()
    worker.command_at(T, 4, 4)
    worker.line.at(T + 10, lambda: worker.fault_on_writes(*[Fault.IGNORE] * 8))
    with caplog.at_level(logging.INFO):
        worker.run(T + 120)
    told = [r.message for r in caplog.records if "max_on" in r.message]
    assert len(told) == 2
    assert "failed: not_confirmed" in told[0]
    assert told[1].endswith("done")
    own = [v for v in worker.verdicts() if v.by == "max_on"]
    assert [v.status for v in own] == [Status.FAILED, Status.DONE]
    assert worker.line.modules[1].outputs == 0


def test_a_module_that_comes_back_on_is_switched_off_when_it_was_due_meanwhile() -> None:
    """A due OFF waits while the module is away, and follows when it answers."""
    worker = _limited()
    worker.command_at(T, 4, 4)
    worker.line.at(T + 5, lambda: setattr(worker.line.modules[1], "away", True))
    worker.line.at(T + 40, lambda: setattr(worker.line.modules[1], "away", False))
    worker.run(T + 80)
    (_, (off_at, off)) = _orders(worker)
    (back_at, _) = worker.online_at()[-1]
    assert not off
    assert 0 <= off_at - back_at < 0.5
    assert all(at < T + 6 or at > T + 40 for at, frame in worker.line.wire if is_write(frame))


def test_on_again_counts_anew_while_another_output_is_switched_off() -> None:
    """OFF and ON of one module are seen for what they are, whatever another's `max_on` does."""
    outputs = (OutputConfig(OUTPUT, max_on_s=20.0),)
    stations = (make_station(1, outputs=outputs), make_station(2, outputs=outputs))
    for late_s in (0.0, 0.02, 0.04, 0.06, 0.08):
        worker = VirtualWorker(make_line(*stations, protocol=LineProtocol.MODBUS_RTU))
        worker.command_at(T, 4, 4, station_id="s1")
        worker.command_at(T + 1, 4, 4, station_id="s2")
        worker.command_at(T + 19.96 + late_s, 4, 0, station_id="s2")
        worker.command_at(T + 19.99 + late_s, 4, 4, station_id="s2")
        worker.run(T + 35)
        ordered = [s.value for s in worker.line.modules[2].switchings if s.frame]
        assert ordered in ([True, False, True], [True, True, False])


@pytest.mark.parametrize("late_s", [0.2, 0.6, 1.0, 1.5, 2.0, 3.0])
def test_a_command_does_not_wait_for_orders_to_modules_that_are_silent(late_s: float) -> None:
    """Three modules with five outputs due each have just died: the fourth obeys (promise 7)."""
    outputs = tuple(OutputConfig(n, max_on_s=10.0) for n in range(1, 9))
    dying = [make_station(address, outputs=outputs) for address in (1, 2, 3)]
    worker = VirtualWorker(make_line(*dying, make_station(4)))
    for address in (1, 2, 3):
        module = worker.line.modules[address]
        module.write_outputs(0b11111, 0b11111, b"")
        worker.line.at(T + 0.2, partial(setattr, module, "away", True))
    worker.command_at(T + late_s, 1, 1, station_id="s4", command_id="live")
    worker.run(T + 10)
    (live,) = (verdict for verdict in worker.verdicts() if verdict.id == "live")
    assert live.status is Status.DONE
    told = Counter(frame[1:3] for _, frame in worker.line.wire if is_write(frame))
    assert all(told[b"0%d" % address] <= 1 for address in (1, 2, 3))  # then only what is heard


def test_without_it_nothing_is_switched() -> None:
    """Without `max_on` nothing is switched."""
    worker = _worker(OutputConfig(OUTPUT))
    worker.command_at(T, 4, 4)
    _loses_broker(worker, T)
    worker.run(T + 40)
    assert len(_orders(worker)) == 1


# --- on_loss --------------------------------------------------------------------------------------


@pytest.mark.parametrize("on", [True, False])
def test_an_output_takes_its_state_when_the_broker_is_away(on: bool) -> None:
    """`on_loss` switches once in a loss, and nothing is switched back."""
    worker = _guarded(on=on)
    _loses_broker(worker, T, T + 20)
    worker.run(T + 30)
    ((at, value),) = _orders(worker)
    assert value is on
    assert AFTER_S <= at - T <= AFTER_S + 0.5
    verdict = worker.verdict()
    assert (verdict.status, verdict.by) == (Status.DONE, "on_loss")


def test_a_broker_that_comes_back_during_a_burst_of_commands_is_no_loss() -> None:
    """It is away for 1.9 s of 2 s, and commands keep the line busy for a second more."""
    outputs = (OutputConfig(OUTPUT, on_loss=OnLossConfig(2.0, on=False)),)
    worker = VirtualWorker(make_line(make_station(1, outputs=outputs), make_station(2)))
    worker.line.modules[1].set_output(OUTPUT, True)
    _loses_broker(worker, T, T + 1.9)
    for n in range(60):
        at = T + 1.8 + n / 50
        worker.command_at(at, 1, word=Word.TOGGLE, station_id="s2", command_id=str(n))
    worker.run(T + 10)
    assert _orders(worker) == []


def test_a_module_that_was_away_takes_its_state_when_it_comes_back() -> None:
    """While the loss lasts it is owed."""
    worker = _guarded(on=False)
    module = worker.line.modules[1]
    module.set_output(OUTPUT, True)
    worker.line.at(T, lambda: setattr(module, "away", True))
    worker.line.at(T + 20, lambda: setattr(module, "away", False))
    _loses_broker(worker, T)
    worker.run(T + 40)
    assert [value for _, value in _orders(worker)] == [False]


def test_every_output_takes_its_own_state_while_reads_go_on() -> None:
    """16 outputs of one loss: one write at a time, and between any two of them a read."""
    outputs = tuple(
        OutputConfig(n, on_loss=OnLossConfig(AFTER_S, on=n % 2 == 0)) for n in range(1, 17)
    )
    worker = VirtualWorker(make_line(make_station(model=DO100, outputs=outputs), make_station(2)))
    _loses_broker(worker, T)
    worker.run(T + 15)
    assert worker.line.modules[1].outputs == 0xAAAA
    assert sum(worker.line.modules[1].ordered.values()) == 16
    polls = 0
    for _, frame in worker.line.wire:
        if is_write(frame):
            assert polls > 0
            polls = 0
        elif frame.startswith(b"#"):  # a poll; read-backs go in Modbus frames here
            polls += 1


def test_an_on_that_may_have_been_a_pulse_is_never_repeated() -> None:
    """Over Wisco frames alone it is not known the mode: one transmission (promise 1)."""
    worker = _guarded(on=True, writes=Writes.WISCO)
    worker.fault_on_writes(Fault.LOSE_REQUEST)
    _loses_broker(worker, T)
    worker.run(T + 40)
    assert len(worker.writes()) == 1
    assert _orders(worker) == []
    assert (worker.verdict().status, worker.verdict().by) == (Status.UNKNOWN, "on_loss")


def test_a_lost_on_of_a_latch_is_made_again() -> None:
    """A lost ON of an output that was read as latch is ordered again."""
    worker = _guarded(on=True)
    worker.fault_on_writes(*[Fault.LOSE_REQUEST] * 5)
    _loses_broker(worker, T)
    worker.run(T + 40)
    assert worker.line.modules[1].outputs == 4
    assert worker.verdicts()[-1].status is Status.DONE


def test_an_output_that_is_a_pulse_in_the_module_is_not_fired() -> None:
    """ON would not stay: said once, and nothing is sent."""
    worker = _guarded(on=True)
    worker.line.modules[1].set_mode(OUTPUT, pulse=True)
    _loses_broker(worker, T)
    worker.run(T + 40)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason) == (Status.REFUSED, Reason.BAD_PAYLOAD)
    assert worker.writes() == []


def test_the_interlock_holds_when_the_broker_is_away(caplog: pytest.LogCaptureFixture) -> None:
    """The other one is ON: refused, and done as soon as it is OFF, while the loss lasts."""
    worker = _worker(
        OutputConfig(OUTPUT, on_loss=OnLossConfig(AFTER_S, on=True)),
        OutputConfig(4),
        interlock=(0b1100,),
    )
    module = worker.line.modules[1]
    module.set_output(4, True)
    worker.line.at(T + 10, lambda: module.set_output(4, False))
    _loses_broker(worker, T)
    worker.run(T + 30)
    first, last = worker.verdicts()
    assert (first.status, first.reason) == (Status.REFUSED, Reason.INTERLOCK)
    assert last.status is Status.DONE
    ((on_at, _),) = _orders(worker)
    assert on_at > T + 10.5
    assert len([r for r in caplog.records if "on_loss" in r.message]) <= 2


def test_a_command_that_waits_is_not_overruled_by_a_repeat() -> None:
    """The broker is back, and so is its user: what he asked for stays."""
    worker = _guarded(on=False)
    _loses_broker(worker, T, T + 10)
    worker.command_at(T + 11, 4, 4)
    worker.run(T + 30)
    assert [value for _, value in _orders(worker)] == [False, True]
    assert isinstance(worker.verdicts()[-1], Verdict)
