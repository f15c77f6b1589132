"""Modes and hold times that a tool at the module changes while the bridge runs."""

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import OnLossConfig, OutputConfig
from bridge.model import (
    LineProtocol,
    ProblemChanged,
    Reason,
    Setting,
    SettingCommand,
    SettingsRead,
    StationChanged,
    Status,
    Word,
)
from bridge.simulator.faults import is_write
from bridge.simulator.module import SimulatedModule

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 102.0
END = T + 3.0
every_protocol = pytest.mark.parametrize("protocol", list(LineProtocol))


def _worker(
    protocol: LineProtocol = LineProtocol.MODBUS_RTU,
    *outputs: OutputConfig,
    pulse: int = 0,
    hold_s: float = 1.0,
) -> tuple[VirtualWorker, SimulatedModule]:
    """A worker whose module `s1` has these pulse outputs when it is met."""
    line = make_line(make_station(outputs=outputs or None), protocol=protocol)
    worker = VirtualWorker(line)
    module = worker.line.modules[1]
    for output in range(1, 9):
        if pulse >> (output - 1) & 1:
            module.set_mode(output, pulse=True, hold_s=hold_s)
    return worker, module


def _judged(worker: VirtualWorker) -> tuple[Status, Reason | None]:
    verdict = worker.verdict()
    return verdict.status, verdict.reason


def _is_settings_read(frame: bytes) -> bool:
    return frame[3:5] == b"03" if frame.startswith(b":") else frame[1:2] == b"\x03"


def _lost_settings(worker: VirtualWorker, since: float = T) -> None:
    """No read of settings is answered from then on."""

    def fault(frame: bytes) -> Fault | None:
        asked = worker.line.now >= since and _is_settings_read(frame)
        return Fault.LOSE_REPLY if asked else None

    worker.line.fault = fault


# --- right before a write -------------------------------------------------------------------------


@every_protocol
@pytest.mark.parametrize("word", [Word.PRESS, None])
def test_a_pulse_that_became_a_latch_is_not_switched_on(
    protocol: LineProtocol, word: Word | None
) -> None:
    """It would stay ON (docs/failures.md F4). The new mode is told first; then ON means a latch."""
    worker, module = _worker(protocol, pulse=0b10)
    worker.line.at(T - 0.01, lambda: module.set_mode(2, pulse=False))
    worker.command_at(T, 0b10, 0b10, word=word)
    worker.command_at(T + 2, 0b10, 0b10)
    worker.run(END)
    refused, done = worker.verdicts()
    assert (refused.status, refused.reason) == (Status.REFUSED, Reason.BAD_PAYLOAD)
    assert "output 2 in latch mode" in str(refused.detail)
    assert worker.reported(T)[0] == SettingsRead("s1", module.settings)
    assert refused in worker.reported(T)
    assert done.status is Status.DONE
    assert module.outputs == 0b10
    assert len(worker.writes()) == 1


@every_protocol
def test_a_press_whose_modes_cannot_be_read_sends_nothing(protocol: LineProtocol) -> None:
    """`failed` / `no_reply`: it is never guessed."""
    worker, _ = _worker(protocol, pulse=0b10)
    _lost_settings(worker)
    worker.command_at(T, 0b10, 0b10, word=Word.PRESS)
    worker.run(END)
    assert _judged(worker) == (Status.FAILED, Reason.NO_REPLY)
    assert "nothing was sent" in str(worker.verdict().detail)
    assert worker.writes() == []


@every_protocol
def test_a_pulse_that_becomes_a_latch_in_that_moment_is_switched_off(
    protocol: LineProtocol,
) -> None:
    """Between the read of its mode and the write: `failed`, and no relay stays ON."""
    worker, module = _worker(protocol, pulse=0b10, hold_s=2.0)

    def fault(frame: bytes) -> None:
        if is_write(frame):
            module.set_mode(2, pulse=False)

    worker.line.fault = fault
    worker.command_at(T, 0b10, 0b10, word=Word.PRESS)
    worker.run(END)
    assert _judged(worker) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert "switched OFF" in str(worker.verdict().detail)
    assert module.outputs == 0
    assert module.ordered == {(2, True): 1, (2, False): 1}


@every_protocol
def test_a_latch_that_became_a_pulse_gets_one_on(protocol: LineProtocol) -> None:
    """Its reply is lost, it is over before it is read: no second one (promise 1)."""
    worker, module = _worker(protocol)
    worker.line.baud = 1200
    worker.line.at(T - 0.1, lambda: module.set_mode(2, pulse=True, hold_s=0.1))
    worker.fault_on_writes(Fault.LOSE_REPLY)
    worker.command_at(T, 0b10, 0b10)
    worker.run(END)
    assert module.ordered == {(2, True): 1}
    assert _judged(worker) == (Status.UNKNOWN, Reason.NO_REPLY)


@every_protocol
def test_an_on_is_not_repeated_where_modes_cannot_be_read(protocol: LineProtocol) -> None:
    """It may have become a pulse."""
    worker, module = _worker(protocol)

    def fault(frame: bytes) -> Fault | None:
        if worker.line.now < T:
            return None
        if is_write(frame):
            return Fault.LOSE_REQUEST
        return Fault.LOSE_REPLY if _is_settings_read(frame) else None

    worker.line.fault = fault
    worker.command_at(T, 0b10, 0b10)
    worker.run(END)
    assert _judged(worker) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert len(worker.writes()) == 1
    assert module.ordered == {}


@every_protocol
def test_an_off_is_repeated_without_a_look_at_modes(protocol: LineProtocol) -> None:
    """It starts no pulse, and a motor waits for it."""
    worker, module = _worker(protocol)
    module.set_output(2, True)
    worker.fault_on_writes(Fault.LOSE_REQUEST)
    worker.command_at(T, 0b10, 0)
    worker.run(END)
    assert _judged(worker) == (Status.DONE, None)
    assert not [at for at, frame in worker.line.wire if _is_settings_read(frame) and at >= T]


@every_protocol
def test_a_single_latch_write_takes_no_read_of_modes(protocol: LineProtocol) -> None:
    """It takes as long as ever."""
    worker, _ = _worker(protocol)
    worker.command_at(T, 0b10, 0b10)
    worker.run(T + 1)
    assert _judged(worker) == (Status.DONE, None)
    assert not [at for at, frame in worker.line.wire if _is_settings_read(frame) and at >= T]


# --- gaps -----------------------------------------------------------------------------------------


@every_protocol
def test_a_gap_that_became_a_pulse_keeps_its_time(protocol: LineProtocol) -> None:
    """`busy`, though nobody told us of its mode."""
    worker, module = _worker(protocol)
    worker.line.at(T - 0.2, lambda: module.set_mode(2, pulse=True, hold_s=2.0))
    worker.line.at(T - 0.1, lambda: module.set_output(2, True))
    worker.command_at(T, 0b101, 0b101)
    worker.run(END)
    assert _judged(worker) == (Status.REFUSED, Reason.BUSY)
    assert worker.writes() == []


@every_protocol
def test_gaps_whose_modes_cannot_be_read_are_not_written(protocol: LineProtocol) -> None:
    """The write is split: one frame for each run of outputs, and one verdict."""
    worker, module = _worker(protocol)
    _lost_settings(worker)
    worker.command_at(T, 0b1011, 0b1001)
    worker.run(END)
    assert _judged(worker) == (Status.DONE, None)
    assert set(module.ordered) == {(1, True), (2, False), (4, True)}
    assert len(worker.writes()) == 2


@every_protocol
def test_a_read_only_gap_is_never_written(protocol: LineProtocol) -> None:
    """What another master switched just then stays as it is (docs/failures.md F8)."""
    outputs = tuple(OutputConfig(n, read_only=n == 2) for n in range(1, 9))
    worker, module = _worker(protocol, *outputs)

    def fault(frame: bytes) -> None:
        if is_write(frame):
            module.set_output(2, True)

    worker.line.fault = fault
    worker.command_at(T, 0b101, 0b001)
    worker.run(END)
    assert _judged(worker) == (Status.DONE, None)
    assert module.outputs == 0b011
    assert module.ordered == {(3, False): 1, (1, True): 1}  # OFF first


def _split(deadline_s: float = 2.0) -> tuple[VirtualWorker, SimulatedModule]:
    """Three writes of one command: outputs 1, 3 and 5 ON, and 2 is of another."""
    outputs = tuple(OutputConfig(n, read_only=n in {2, 4}) for n in range(1, 9))
    worker, module = _worker(LineProtocol.MODBUS_RTU, *outputs)
    worker.command_at(T, 0b10101, 0b10101, deadline_s=deadline_s)
    return worker, module


def test_a_split_write_that_loses_a_reply_goes_on_with_what_is_missing() -> None:
    """After a read: latches may be sent once more."""
    worker, module = _split()
    worker.fault_on_writes(None, Fault.LOSE_REQUEST)
    worker.run(END)
    assert _judged(worker) == (Status.DONE, None)
    assert module.outputs == 0b10101


def test_a_split_write_is_not_gone_on_with_after_its_deadline() -> None:
    """`failed` / `not_confirmed`, and what was never sent is named."""
    worker, module = _split(deadline_s=0.035)
    worker.run(END)
    assert _judged(worker) == (Status.FAILED, Reason.NOT_CONFIRMED)
    assert "not sent to output" in str(worker.verdict().detail)
    assert len(worker.writes()) < 3
    assert module.outputs not in {0, 0b10101}


def test_a_port_that_goes_between_two_parts_leaves_it_unknown() -> None:
    """What was sent cannot be taken back, and is not repeated."""
    worker, _ = _split()
    worker.fault_on_writes(None, Fault.PORT_GONE)
    worker.run(END)
    assert _judged(worker) == (Status.UNKNOWN, Reason.PORT_DOWN)
    assert len(worker.writes()) == 1


def test_a_pulse_of_a_split_write_is_sent_once() -> None:
    """Where another part gets no reply: `unknown`, and nothing is sent again."""
    outputs = tuple(OutputConfig(n, read_only=n == 2) for n in range(1, 9))
    worker, module = _worker(LineProtocol.MODBUS_RTU, *outputs, pulse=0b1, hold_s=0.1)
    worker.fault_on_writes(None, Fault.LOSE_REPLY)
    worker.command_at(T, 0b101, 0b101)
    worker.run(END)
    assert _judged(worker) == (Status.UNKNOWN, Reason.NO_REPLY)
    assert module.ordered == {(1, True): 1, (3, True): 1}


# --- without a command ----------------------------------------------------------------------------


@every_protocol
def test_a_changed_mode_is_a_problem_within_a_minute(protocol: LineProtocol) -> None:
    """Declared or not; it is over when the mode is what it was."""
    worker, module = _worker(protocol)
    worker.line.at(T, lambda: module.set_mode(2, pulse=True))
    worker.line.at(T + 70, lambda: module.set_mode(2, pulse=False))
    worker.run(T + 140)
    told = [e for e in worker.reported(T) if isinstance(e, ProblemChanged | SettingsRead)]
    read, problem, read_again, over = told
    assert isinstance(read, SettingsRead)
    assert read.settings is not None
    assert read.settings.pulse == 0b10
    assert problem == ProblemChanged(
        "s1", "settings_differ", "output 2 is in pulse mode, and was in latch mode"
    )
    assert read_again == SettingsRead("s1", module.settings)
    assert over == ProblemChanged("s1", None, "")
    ((at, _),) = [each for each in worker.events if each[1] is problem]
    assert at <= T + 60


def test_a_mode_that_was_set_through_us_is_no_problem() -> None:
    """Who sets it knows."""
    worker, module = _worker()
    command = SettingCommand(
        "s1", "do/2/mode", "pulse", 2, Setting.MODE, 1, arrived=T, deadline=T + 2
    )
    worker.line.at(T, lambda: worker.worker.submit(command))
    worker.run(T + 70)
    assert module.settings.pulse == 0b10
    assert not [e for e in worker.reported(T) if isinstance(e, ProblemChanged)]


@every_protocol
def test_a_lost_read_of_settings_costs_one_exchange(protocol: LineProtocol) -> None:
    """And takes nobody offline: what is known of them stays."""
    worker, module = _worker(protocol, pulse=0b10)
    _lost_settings(worker)
    worker.run(T + 130)
    asked = [at for at, frame in worker.line.wire if _is_settings_read(frame) and at >= T]
    assert len(asked) == 2
    assert not [e for e in worker.reported(T) if isinstance(e, StationChanged | SettingsRead)]
    assert module.settings.pulse == 0b10


@every_protocol
def test_a_module_that_has_no_settings_is_not_asked_again(protocol: LineProtocol) -> None:
    """Until it is met anew; its modes count as unknown."""
    worker, _ = _worker(protocol)
    worker.line.fault = lambda frame: Fault.REFUSE if _is_settings_read(frame) else None
    worker.run(T + 70)
    asked = [at for at, frame in worker.line.wire if _is_settings_read(frame)]
    assert len(asked) == 3
    assert max(asked) < T


@every_protocol
def test_a_module_that_told_its_settings_is_asked_again_after_a_refusal(
    protocol: LineProtocol,
) -> None:
    """Once it said no: a PRESS of what became a latch meanwhile is not sent all the same."""
    worker, module = _worker(protocol, pulse=0b10)
    refused: list[float] = []

    def fault(frame: bytes) -> Fault | None:
        if worker.line.now < T or refused or not _is_settings_read(frame):
            return None
        refused.append(worker.line.now)
        return Fault.REFUSE

    worker.line.fault = fault
    worker.line.at(T + 65, lambda: module.set_mode(2, pulse=False))
    worker.command_at(T + 65.1, 0b10, 0b10, word=Word.PRESS)
    worker.run(T + 70)
    assert refused
    assert _judged(worker) == (Status.REFUSED, Reason.BAD_PAYLOAD)
    assert worker.writes() == []


@every_protocol
def test_an_output_that_changes_unasked_has_its_mode_read_at_once(protocol: LineProtocol) -> None:
    """An ON that goes OFF by itself may have been a pulse; a module may have been exchanged."""
    worker, module = _worker(protocol)
    worker.line.at(T, lambda: module.set_mode(2, pulse=True, hold_s=1.0))
    worker.command_at(T + 0.1, 0b10, 0b10)
    worker.run(T + 4)
    assert [e for e in worker.reported(T) if isinstance(e, ProblemChanged)] == [
        ProblemChanged("s1", "settings_differ", "output 2 is in pulse mode, and was in latch mode")
    ]


@every_protocol
def test_an_order_at_a_loss_is_not_given_to_what_became_a_pulse(protocol: LineProtocol) -> None:
    """ON would not stay; and a second attempt would be a second pulse."""
    output = OutputConfig(2, on_loss=OnLossConfig(on=True, after_s=5.0))
    worker, module = _worker(protocol, output)
    worker.line.at(T, lambda: module.set_mode(2, pulse=True))
    worker.line.at(T, lambda: worker.worker.broker(T))
    worker.run(T + 10)
    assert worker.writes() == []
    (verdict,) = worker.verdicts()
    assert verdict.reason is Reason.BAD_PAYLOAD
