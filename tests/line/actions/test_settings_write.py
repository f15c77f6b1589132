"""Modes and hold times that are set, on a virtual line, for each protocol and model."""

import math
from typing import Any

import pytest
from support.bus_worker import BusWorker, Script
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import OutputConfig
from bridge.model import (
    DIO100,
    DO100,
    LineProtocol,
    ModuleType,
    ProblemChanged,
    Reason,
    Setting,
    SettingCommand,
    SettingsRead,
    Status,
    Verdict,
    Word,
    Writes,
)
from bridge.protocol.request import Request

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 102.0  # when the command comes: long after the module is online
END = T + 3.0
PULSE, LATCH = 1, 0
READ_REGISTERS, WRITE_REGISTER = 3, 6  # docs/protocol.md section 3


def set_at(
    worker: VirtualWorker,
    instant: float,
    setting: Setting,
    output: int,
    value: int,
    *,
    deadline_s: float = 2.0,
) -> None:
    """Has a command arrive at `instant`."""
    command = SettingCommand(
        "s1",
        f"do/{output}/{setting}",
        value,
        output,
        setting,
        value,
        arrived=instant,
        deadline=instant + deadline_s,
    )
    worker.line.at(instant, lambda: worker.worker.submit(command))


def register_writes(worker: VirtualWorker) -> list[bytes]:
    """The frames on the wire that write a register."""
    return [frame for _, frame in worker.line.wire if _code(frame) == WRITE_REGISTER]


def _code(frame: bytes) -> int | None:
    if frame.startswith(b"#"):
        return None
    return int(frame[3:5], 16) if frame.startswith(b":") else frame[1]


@pytest.fixture(params=list(LineProtocol))
def protocol(request: pytest.FixtureRequest) -> LineProtocol:
    """Each protocol; on a Wisco line these commands go as Modbus ASCII."""
    found: LineProtocol = request.param
    return found


def worker_of(protocol: LineProtocol, model: ModuleType = DIO100) -> VirtualWorker:
    """A worker with one module `s1`."""
    return VirtualWorker(make_line(make_station(model=model), protocol=protocol))


@pytest.mark.parametrize("model", [DIO100, DO100])
def test_a_mode_is_set_and_the_others_stay(protocol: LineProtocol, model: ModuleType) -> None:
    """One register holds them all: it is read and written back to back."""
    worker = worker_of(protocol, model)
    module = worker.line.modules[1]
    last = model.outputs
    module.set_mode(2, pulse=True, hold_s=0.7)
    # By hand, after the bridge read the modes: the write must not undo it.
    worker.line.at(T - 1, lambda: module.set_mode(last, pulse=True, hold_s=2.5))
    set_at(worker, T, Setting.MODE, 3, PULSE)
    worker.run(END)
    assert worker.verdict().status is Status.DONE
    assert module.settings.pulse == 1 << 1 | 1 << 2 | 1 << (last - 1)
    assert module.settings.hold_ds[1] == 7
    assert module.eeprom_writes == len(register_writes(worker)) == 1


def test_a_mode_is_taken_back(protocol: LineProtocol) -> None:
    """Latch is 0: that bit alone goes."""
    worker = worker_of(protocol)
    module = worker.line.modules[1]
    for output in (1, 3, 8):
        module.set_mode(output, pulse=True)
    set_at(worker, T, Setting.MODE, 3, LATCH)
    worker.run(END)
    assert worker.verdict().status is Status.DONE
    assert module.settings.pulse == 0b10000001


@pytest.mark.parametrize("hold_ds", [1, 25, 255])
def test_a_hold_time_is_set(protocol: LineProtocol, hold_ds: int) -> None:
    """Of its output alone, from the least to the most."""
    worker = worker_of(protocol)
    set_at(worker, T, Setting.HOLD, 4, hold_ds)
    worker.run(END)
    assert worker.verdict().status is Status.DONE
    assert worker.line.modules[1].settings.hold_ds == (10, 10, 10, hold_ds, 10, 10, 10, 10)
    assert worker.line.modules[1].eeprom_writes == 1


def test_what_is_so_already_is_not_written(protocol: LineProtocol) -> None:
    """The EEPROM wears out: equal commands are reads alone."""
    worker = worker_of(protocol)
    for n in range(30):
        set_at(worker, T + n, Setting.MODE, 3, LATCH)
        set_at(worker, T + n + 0.5, Setting.HOLD, 3, 10)
    worker.run(T + 31)
    assert [verdict.status for verdict in worker.verdicts()] == [Status.DONE] * 60
    assert worker.line.modules[1].eeprom_writes == 0
    assert register_writes(worker) == []
    assert not [event for event in worker.reported(T) if isinstance(event, SettingsRead)]


def test_the_new_setting_is_told_before_the_verdict(protocol: LineProtocol) -> None:
    """As read from the module after the write."""
    worker = worker_of(protocol)
    set_at(worker, T, Setting.MODE, 1, PULSE)
    worker.run(END)
    told, verdict = worker.reported(T)
    assert isinstance(told, SettingsRead)
    assert told.settings is not None
    assert told.settings.pulse == 1
    assert isinstance(verdict, Verdict)
    assert (verdict.target, verdict.payload) == ("do/1/mode", PULSE)


def test_from_then_on_the_output_is_a_pulse(protocol: LineProtocol) -> None:
    """A reply that is lost makes it unknown, and nothing is sent twice (promise 1)."""
    worker = worker_of(protocol)
    set_at(worker, T, Setting.MODE, 1, PULSE)
    worker.line.at(T + 1, lambda: worker.fault_on_writes(Fault.LOSE_REPLY))
    worker.command_at(T + 2, 1, 1)
    worker.run(END)
    assert worker.verdicts()[1].status is Status.UNKNOWN
    switched = [s for s in worker.line.modules[1].switchings if s.output == 1 and s.value]
    assert len(switched) == 1


@pytest.mark.parametrize(
    ("faults", "ended", "sent"),
    [
        ([Fault.LOSE_REPLY], (Status.DONE, None, None), 1),
        ([Fault.GARBLE_REPLY], (Status.DONE, None, None), 1),
        ([Fault.LOSE_REQUEST], (Status.DONE, None, None), 2),
        ([Fault.IGNORE], (Status.DONE, None, None), 2),
        ([Fault.IGNORE] * 3, (Status.FAILED, Reason.NOT_CONFIRMED, None), 2),
        ([Fault.REFUSE], (Status.FAILED, Reason.MODULE_REFUSED, 4), 1),
    ],
)
def test_the_read_after_a_write_tells_whether_it_took(
    protocol: LineProtocol,
    faults: list[Fault],
    ended: tuple[Status, Reason | None, int | None],
    sent: int,
) -> None:
    """Only one that did not take is repeated, once; a module that says no is not asked again."""
    worker = worker_of(protocol)
    worker.fault_on_writes(*faults)
    set_at(worker, T, Setting.HOLD, 1, 50)
    worker.run(END)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason, verdict.code) == ended
    assert len(register_writes(worker)) == sent
    assert worker.line.modules[1].eeprom_writes == (verdict.status is Status.DONE)


def test_where_no_read_comes_after_the_write_nobody_knows(protocol: LineProtocol) -> None:
    """It is not written again."""
    worker = worker_of(protocol)
    worker.fault_from_first_write(None, Fault.LOSE_REPLY)
    set_at(worker, T, Setting.MODE, 5, PULSE)
    worker.run(END)
    assert (worker.verdict().status, worker.verdict().reason) == (Status.UNKNOWN, Reason.NO_REPLY)
    assert worker.line.modules[1].eeprom_writes == 1


def test_where_nothing_can_be_read_nothing_is_written(protocol: LineProtocol) -> None:
    """The settings come first: what differs is not known otherwise."""
    worker = worker_of(protocol)
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", True))
    set_at(worker, T, Setting.MODE, 5, PULSE)
    worker.run(END)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason) == (Status.FAILED, Reason.NO_REPLY)
    assert verdict.detail == "nothing was written"
    assert register_writes(worker) == []


def test_a_module_that_refuses_to_be_read(protocol: LineProtocol) -> None:
    """Nothing is written to registers that it does not have."""
    worker = worker_of(protocol)
    worker.line.at(T, lambda: setattr(worker.line, "fault", lambda _: Fault.REFUSE))
    set_at(worker, T, Setting.HOLD, 5, 20)
    worker.run(T + 1)
    assert worker.verdict().reason is Reason.MODULE_REFUSED
    assert register_writes(worker) == []


@pytest.mark.parametrize(("writes", "wisco_only"), [(Writes.WISCO, False), (Writes.AUTO, True)])
def test_where_no_modbus_frames_go_settings_are_read_only(writes: Writes, wisco_only: bool) -> None:
    """Over Wisco frames alone they cannot be reached: nothing is sent at all."""
    worker = VirtualWorker(make_line(writes=writes), wisco_only=wisco_only)
    before = len(worker.line.wire)
    set_at(worker, T, Setting.MODE, 1, PULSE)
    worker.run(END)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason) == (Status.REFUSED, Reason.READ_ONLY)
    assert verdict.detail is not None
    assert "Modbus" in verdict.detail
    assert not [frame for at, frame in worker.line.wire[before:] if at >= T and frame[0:1] == b":"]


def test_station_0_is_never_sent_a_modbus_frame() -> None:
    """There it would be a broadcast (docs/failures.md A9)."""
    worker = VirtualWorker(make_line(make_station(0)))
    command = SettingCommand(
        "s0", "do/1/mode", "pulse", 1, Setting.MODE, PULSE, arrived=T, deadline=T + 2
    )
    worker.line.at(T, lambda: worker.worker.submit(command))
    worker.run(END)
    assert worker.verdict().reason is Reason.READ_ONLY
    assert not [frame for _, frame in worker.line.wire if frame.startswith(b":")]


def test_nothing_is_sent_after_the_deadline(protocol: LineProtocol) -> None:
    """Neither a read nor a write."""
    worker = worker_of(protocol)
    set_at(worker, T, Setting.MODE, 1, PULSE, deadline_s=-0.1)
    worker.run(END)
    assert (worker.verdict().status, worker.verdict().reason) == (Status.REFUSED, Reason.EXPIRED)
    assert register_writes(worker) == []


def test_a_line_that_is_not_free_in_time(
    protocol: LineProtocol, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody else's bytes held it up until the deadline was over: nothing is written."""
    worker = worker_of(protocol)
    exchange = worker.line.exchange

    def held_up(request: Request[Any], *, protected: bool, not_after: float = math.inf) -> Any:
        if _code(request.frame) == WRITE_REGISTER:
            worker.line.advance(T + 2.1)
        return exchange(request, protected=protected, not_after=not_after)

    monkeypatch.setattr(worker.line, "exchange", held_up)
    set_at(worker, T, Setting.MODE, 1, PULSE)
    worker.run(END)
    assert (worker.verdict().status, worker.verdict().reason) == (Status.REFUSED, Reason.EXPIRED)
    assert register_writes(worker) == []


def test_a_deadline_that_passes_while_reading(protocol: LineProtocol) -> None:
    """The reads took too long: it is not written any more."""
    worker = worker_of(protocol)
    left = [Fault.LOSE_REPLY, Fault.LOSE_REPLY]
    worker.line.at(T, lambda: setattr(worker.line, "fault", lambda _: left.pop() if left else None))
    set_at(worker, T, Setting.MODE, 1, PULSE, deadline_s=0.1)
    worker.run(END)
    assert worker.verdict().reason is Reason.EXPIRED
    assert register_writes(worker) == []


@pytest.mark.parametrize(
    ("fault", "status"), [(Fault.PORT_GONE, Status.FAILED), (Fault.PORT_GONE_AFTER, Status.UNKNOWN)]
)
def test_a_port_that_goes_away(protocol: LineProtocol, fault: Fault, status: Status) -> None:
    """Before anything was sent it failed; else it is not known, and it is not sent again."""
    worker = worker_of(protocol)
    if fault is Fault.PORT_GONE:
        worker.line.at(T, lambda: setattr(worker.line, "fault", lambda _: fault))
        worker.line.at(T + 1, lambda: setattr(worker.line, "fault", lambda _: None))
    else:
        worker.fault_on_writes(fault)
    set_at(worker, T, Setting.MODE, 1, PULSE)
    worker.run(T + 5)
    assert (worker.verdict().status, worker.verdict().reason) == (status, Reason.PORT_DOWN)
    assert len(register_writes(worker)) == (fault is Fault.PORT_GONE_AFTER)
    assert len(worker.online_at()) == 3


def test_of_values_that_wait_the_last_is_written() -> None:
    """A slider that is drawn wears out no EEPROM; a command for another setting stays."""
    worker = VirtualWorker()
    for hold_ds in (20, 30, 40):
        set_at(worker, T, Setting.HOLD, 1, hold_ds)
    set_at(worker, T, Setting.MODE, 1, PULSE)
    set_at(worker, T, Setting.HOLD, 2, 99)
    set_at(worker, T, Setting.HOLD, 1, 50)
    worker.run(END)
    reasons = [(v.payload, v.reason) for v in worker.verdicts() if v.status is Status.REFUSED]
    assert reasons == [(value, Reason.SUPERSEDED) for value in (20, 30, 40)]
    assert worker.line.modules[1].settings.hold_ds[:2] == (50, 99)
    assert worker.line.modules[1].eeprom_writes == 3


def test_what_was_set_for_a_command_that_follows_is_not_overtaken() -> None:
    """Pulse, press, latch: each in its turn."""
    worker = VirtualWorker()
    set_at(worker, T, Setting.MODE, 1, PULSE)
    worker.command_at(T, 1, word=Word.PRESS)
    set_at(worker, T, Setting.MODE, 1, LATCH)
    worker.run(END)
    assert [verdict.status for verdict in worker.verdicts()] == [Status.DONE] * 3


def test_a_difference_that_is_found_on_the_way_is_a_problem() -> None:
    """Somebody changed another output by hand: the read before the write shows it."""
    outputs = (OutputConfig(1), OutputConfig(2, mode="pulse", hold_s=0.5))
    worker = VirtualWorker(make_line(make_station(outputs=outputs)))
    module = worker.line.modules[1]
    module.set_mode(2, pulse=True, hold_s=0.5)
    worker.line.at(T - 1, lambda: module.set_mode(2, pulse=True, hold_s=0.9))
    set_at(worker, T, Setting.HOLD, 1, 50)
    worker.run(END)
    (problem,) = [event for event in worker.reported(T) if isinstance(event, ProblemChanged)]
    assert problem == ProblemChanged(
        "s1", "settings_differ", "output 2 holds 0.9 s, declared 0.5 s"
    )


# --- replies that come late -----------------------------------------------------------------------


def is_settings_read(frame: bytes) -> bool:
    """Whether it reads holding registers."""
    return _code(frame) == READ_REGISTERS


@pytest.mark.parametrize("late_ms", range(120, 420, 20))
def test_a_reply_from_before_the_write_undoes_nothing(protocol: LineProtocol, late_ms: int) -> None:
    """The reply to a read before it may come at any moment after: it is not taken for news."""
    worker = BusWorker(make_line(make_station(), protocol=protocol))
    late_s = late_ms / 1000

    def script() -> Script:
        worker.bus_line.faults.set("late", times=1, delay_s=late_s, only=is_settings_read)
        now = worker.line.now
        yield SettingCommand(
            "s1", "do/3/mode", "pulse", 3, Setting.MODE, PULSE, arrived=now, deadline=now + 2
        )
        yield 1.0

    worker.follow(script())
    assert worker.verdict().status is Status.DONE
    assert worker.line.modules[1].settings.pulse == 0b100
    assert worker.line.modules[1].eeprom_writes == len(register_writes(worker)) == 1
    told = [event for _, event in worker.events if isinstance(event, SettingsRead)]
    assert [e.settings.pulse for e in told if e.settings] == [0, 0b100]
