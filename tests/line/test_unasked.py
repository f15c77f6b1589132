"""Warnings about outputs that changed without an order, on a virtual line (docs/failures.md A7)."""

import logging

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.bounded_log import BURST_LINES, REFILL_S
from bridge.model import LineProtocol, Status, Word, Writes

T = 103.0


def told(caplog: pytest.LogCaptureFixture) -> list[str]:
    """Return the warnings."""
    texts = [record.getMessage() for record in caplog.records]
    return [text for text in texts if "unasked" in text]


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_an_output_that_changes_by_itself_is_warned_of(
    protocol: LineProtocol, caplog: pytest.LogCaptureFixture
) -> None:
    """Line, station and output are named, and what it is now."""
    worker = VirtualWorker(make_line(protocol=protocol))
    worker.line.at(T, lambda: worker.line.modules[1].set_output(3, True))
    with caplog.at_level(logging.WARNING):
        worker.run(T + 5)
    assert told(caplog) == ["line main station 1 (s1): output 3 changed unasked to ON"]
    assert [getattr(record, "station", None) for record in caplog.records] == ["s1"]


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
def test_what_goes_on_is_counted(caplog: pytest.LogCaptureFixture) -> None:
    """An output that another master switches all the time gives few, summed up lines."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2)))
    for n in range(150):
        worker.line.at(T + n, lambda n=n: worker.line.modules[1].set_output(1, n % 2 == 0))  # type: ignore[misc]  # a lambda with a default
    worker.line.at(T + 10, lambda: worker.line.modules[2].set_output(2, True))
    with caplog.at_level(logging.WARNING):
        worker.run(T + 1.05 * REFILL_S)
    about_s1 = [text for text in told(caplog) if "(s1)" in text]
    assert len(about_s1) == BURST_LINES + 1
    # Of 150 changes 10 were seen: outputs that nobody is waiting for are read seldom.
    assert about_s1[-1].endswith("(and 3 times more since the last line about it)")
    assert sum("(s2)" in text for text in told(caplog)) == 1


@pytest.mark.parametrize("writes", list(Writes))
def test_what_was_asked_for_is_not_warned_of(
    writes: Writes, caplog: pytest.LogCaptureFixture
) -> None:
    """Ordered changes give no warning: latches, pulses with their end, several outputs."""
    worker = VirtualWorker(make_line(writes=writes))
    worker.line.modules[1].set_mode(2, pulse=True, hold_s=0.5)
    worker.command_at(T, 1, 1)
    worker.command_at(T + 1, 2, 2)
    worker.command_at(T + 4, 1, word=Word.TOGGLE)
    worker.command_at(T + 5, 0b1101, 0b1001)
    with caplog.at_level(logging.WARNING):
        worker.run(T + 10)
    assert {verdict.status for verdict in worker.verdicts()} == {Status.DONE}
    assert told(caplog) == []


def test_a_pulse_that_begins_by_itself_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    """A pulse that begins by itself gives a warning, its end none."""
    worker = VirtualWorker()
    worker.line.modules[1].set_mode(2, pulse=True, hold_s=20.0)
    worker.line.at(T, lambda: worker.line.modules[1].set_output(2, True))
    with caplog.at_level(logging.WARNING):
        worker.run(T + 90)
    assert told(caplog) == ["line main station 1 (s1): output 2 changed unasked to ON"]


def test_where_nobody_knows_the_modes_going_off_is_a_pulse_that_ended(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A module that takes no Modbus frames: any output may be a pulse."""
    worker = VirtualWorker(wisco_only=True)
    worker.line.modules[1].set_output(4, True)
    worker.line.at(T, lambda: worker.line.modules[1].set_output(4, False))
    with caplog.at_level(logging.WARNING):
        worker.run(T + 5)
    assert told(caplog) == []


def test_a_command_that_nobody_saw_confirmed_may_still_come_true(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """An unconfirmed command may still be obeyed once without a warning."""
    worker = VirtualWorker()
    worker.fault_on_writes(Fault.IGNORE, Fault.IGNORE)
    worker.command_at(T, 1, 1)
    worker.line.at(T + 2, lambda: worker.line.modules[1].set_output(1, True))
    worker.line.at(T + 4, lambda: worker.line.modules[1].set_output(1, False))
    with caplog.at_level(logging.WARNING):
        worker.run(T + 8)
    assert worker.verdict().status is Status.FAILED
    assert told(caplog) == ["line main station 1 (s1): output 1 changed unasked to OFF"]


def test_another_output_that_a_command_switched_is_warned_of(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The read after a damaged write shows what it did: before any poll."""
    worker = VirtualWorker(make_line(writes=Writes.WISCO))

    def meddle(frame: bytes) -> None:
        if b"WDO" in frame:
            worker.line.modules[1].set_output(6, True)

    worker.line.fault = meddle
    worker.command_at(T, 1, 1)
    with caplog.at_level(logging.WARNING):
        worker.run(T + 5)
    assert worker.verdict().status is Status.DONE
    assert told(caplog) == ["line main station 1 (s1): output 6 changed unasked to ON"]


def test_what_changed_while_a_module_was_away_is_not_warned_of(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Power was cut, perhaps: it is met as a stranger."""
    worker = VirtualWorker()
    module = worker.line.modules[1]
    worker.line.at(T, lambda: setattr(module, "away", True))
    worker.line.at(T + 10, lambda: module.set_output(1, True))
    worker.line.at(T + 10, lambda: setattr(module, "away", False))
    with caplog.at_level(logging.WARNING):
        worker.run(T + 30)
    assert told(caplog) == []
