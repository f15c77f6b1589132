"""What a line does while a reply may come late that carries no station."""

from itertools import pairwise

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.model import (
    Status,
    ValuesChanged,
    Writes,
)

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 103.0


def test_a_command_goes_out_first_after_a_late_window() -> None:
    """While no request may be sent the queue is looked at: the write comes before the poll."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2), writes=Writes.WISCO))
    lost = [Fault.LOSE_REPLY]
    worker.line.fault = lambda _: lost.pop() if lost and worker.line.now >= T else None
    worker.command_at(T + 0.3, 1, 1)
    worker.run(T + 2)
    first = next(frame for at, frame in worker.line.wire if at > T + 0.15)
    assert [first] == worker.writes()


def waiting_for_a_late_reply(*wisco_only: int) -> tuple[VirtualWorker, list[tuple[float, bytes]]]:
    """Three modules, and what is sent from the miss of s1 until no late reply can come."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2), make_station(3)))
    for address in wisco_only:
        worker.line.modules[address].wisco_only = True
    quiet = list[tuple[float, bytes]]()

    def fault(frame: bytes) -> Fault | None:
        line = worker.line
        if T <= line.now < line.quiet_until:
            quiet.append((line.now, frame))
        lost = line.now >= T and line.quiet_until < T and frame.startswith(b"#01")
        return Fault.LOSE_REPLY if lost else None

    worker.line.fault = fault
    return worker, quiet


def test_while_a_late_reply_may_come_the_others_are_read_in_frames_that_say_whose() -> None:
    """A Wisco reply does not: such frames rest (promise 5), and an input is seen all the same."""
    worker, quiet = waiting_for_a_late_reply()
    worker.line.at(T + 0.2, lambda: worker.line.modules[2].set_input(5, True))
    worker.run(T + 2)
    assert {frame[:3] for _, frame in quiet} == {b":02", b":03"}
    assert len(quiet) >= 4
    (seen_at,) = [at for at, event in worker.events if event == ValuesChanged("s2", 16, 0)]
    assert T + 0.2 < seen_at < worker.line.quiet_until
    assert worker.line.wire[-1][1].startswith(b"#")


def test_a_command_does_not_wait_until_no_late_reply_can_come() -> None:
    """Its frames say whose they are; nothing is asked of a module that takes no such frames."""
    worker, quiet = waiting_for_a_late_reply(2)
    worker.command_at(T + 0.2, 1, 1, station_id="s3")
    worker.run(T + 2)
    (write,) = worker.writes()
    (written_at,) = [at for at, frame in quiet if frame == write]
    assert T + 0.2 <= written_at < T + 0.25
    assert {frame[:3] for _, frame in quiet} == {b":03"}
    assert worker.verdict().status is Status.DONE


def test_a_module_that_takes_no_such_frames_keeps_no_other_waiting() -> None:
    """Its turn comes when no late reply can: meanwhile the others are read on."""
    worker, quiet = waiting_for_a_late_reply(2)
    worker.run(T + 2)
    assert {frame[:3] for _, frame in quiet} == {b":03"}
    asked = [at for at, _ in (*quiet, (worker.line.quiet_until, b""))]
    assert max(later - at for at, later in pairwise(asked)) < 0.06
    after = [(at, frame) for at, frame in worker.line.wire if at >= worker.line.quiet_until]
    assert any(frame.startswith(b"#02") for _, frame in after[:2])  # a retry of s1 may be first
