"""A port that is a device on this machine: lost, absent, and back."""

import logging
from itertools import pairwise

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.model import (
    LineChanged,
    LineProtocol,
    ProblemChanged,
    Reason,
    SettingsRead,
    StationChanged,
    Status,
    ValuesChanged,
    Word,
)

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 103.0
LATER = 110.0  # the port has held for long enough to be told at once
PROTOCOLS = list(LineProtocol)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_lost_port_takes_its_modules_and_then_the_line_offline(protocol: LineProtocol) -> None:
    """Then it is opened anew, everything is read anew, and no relay was switched (promise 4)."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2), protocol=protocol))
    worker.line.modules[1].set_output(1, True)

    def pull() -> None:
        worker.line.open_error = "no such device"
        worker.line.fault = lambda _: Fault.PORT_GONE

    def plug() -> None:
        worker.line.open_error = None
        worker.line.fault = lambda _: None

    worker.line.at(LATER, pull)
    worker.line.at(LATER + 30, plug)
    worker.run(LATER + 40)
    first, second, third, fourth, *back = worker.reported(LATER)
    assert isinstance(first, StationChanged)
    assert isinstance(second, StationChanged)
    assert third == LineChanged("main", online=False, detail="the port is gone")
    assert fourth == LineChanged("main", online=True, detail="/dev/rs485")
    assert [type(event) for event in back] == [
        SettingsRead,
        ValuesChanged,
        ProblemChanged,
        StationChanged,
    ] * 2
    assert worker.writes() == []
    for station_id in ("s1", "s2"):
        came_back_at, online = worker.online_at(station_id)[-1]
        assert online
        assert came_back_at - (LATER + 30) <= 5.0
        assert came_back_at - worker.line.opened[-1] <= 1.0
    assert worker.line.closed == 2


def test_a_port_is_opened_again_soon_and_then_every_two_seconds() -> None:
    """0.25, 0.5, 1, 2, 2 ... for ever; an adapter that is absent at start is no exit."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.run(110.0)
    opened = worker.line.opened
    pauses = [later - earlier for earlier, later in pairwise(opened)]
    assert pauses == pytest.approx([0.25, 0.5, 1, 2, 2, 2, 2])
    assert worker.reported() == [
        LineChanged("main", online=False, detail="/dev/rs485: no such device")
    ]
    assert worker.line.closed == 0


def test_a_port_that_opens_and_fails_at_once_is_not_up() -> None:
    """A gateway that hangs up on everybody: said once, and tried every two seconds."""
    worker = VirtualWorker()
    worker.line.fault = lambda _: Fault.PORT_GONE
    worker.run(160.0)
    assert worker.reported() == [LineChanged("main", online=False, detail="the port is gone")]
    assert 20 <= len(worker.line.opened) <= 40
    assert worker.line.closed == len(worker.line.opened)


def test_a_port_that_goes_while_a_module_is_met_leaves_nothing_of_it() -> None:
    """What was read before counts for nothing: a stranger may be there when it is back."""
    worker = VirtualWorker()
    left = [None, None, None, Fault.PORT_GONE]
    worker.line.fault = lambda _: left.pop(0) if left else None
    worker.line.at(100.2, lambda: worker.line.modules[1].set_input(1, True))
    worker.run(105.0)
    assert [e for e in worker.reported() if isinstance(e, ValuesChanged)] == [
        ValuesChanged("s1", 1, 0)
    ]


def test_the_line_is_up_when_nobody_answers() -> None:
    """The port is there: that the modules are not is another matter."""
    worker = VirtualWorker()
    worker.line.modules[1].away = True
    worker.run(105.0)
    assert worker.reported() == [
        LineChanged("main", online=True, detail="/dev/rs485"),
        ProblemChanged("s1", "no_reply", "station 1 did not answer"),
    ]


def test_a_port_that_had_held_is_opened_again_soon() -> None:
    """A back-off of long ago is forgotten."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.line.at(120.0, lambda: setattr(worker.line, "open_error", None))
    left = [Fault.PORT_GONE]
    worker.line.at(
        140.0, lambda: setattr(worker.line, "fault", lambda _: left.pop() if left else None)
    )
    worker.run(145.0)
    lost_at = next(at for at, e in worker.events if at >= 140.0 and isinstance(e, LineChanged))
    assert worker.line.opened[-1] - lost_at == pytest.approx(0.25)


def test_commands_while_the_port_is_gone_are_refused_at_once() -> None:
    """Those that waited too: none is carried out later (promise 2)."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.command_at(103.4, 1, 1)
    worker.line.at(104.0, lambda: setattr(worker.line, "open_error", None))
    worker.run(110.0)
    verdict = worker.verdict()
    assert (verdict.status, verdict.reason, verdict.ms) == (Status.REFUSED, Reason.OFFLINE, 0)
    assert worker.writes() == []


def test_commands_that_wait_when_the_port_goes_are_refused_at_once() -> None:
    """They get their verdicts before the pause, not after it."""
    worker = VirtualWorker(make_line(protocol=LineProtocol.MODBUS_RTU))
    worker.fault_on_writes(Fault.PORT_GONE)
    for n, command_id in enumerate("abc"):
        worker.command_at(T, 1 << n, word=Word.TOGGLE, command_id=command_id)
    worker.run(T + 5)
    assert [(v.id, v.status, v.reason) for v in worker.verdicts()] == [
        ("a", Status.UNKNOWN, Reason.PORT_DOWN),
        ("b", Status.REFUSED, Reason.OFFLINE),
        ("c", Status.REFUSED, Reason.OFFLINE),
    ]
    assert all(verdict.ms < 100 for verdict in worker.verdicts())
    assert worker.writes() == []


def test_a_stop_while_the_port_is_gone_ends_the_wait() -> None:
    """Not after the pause: the service stops at once."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.run(103.9)
    assert worker.line.now == 103.9


def test_a_lost_port_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    """However often it is opened in vain; and its return is logged."""
    worker = VirtualWorker()
    worker.line.open_error = "no such device"
    worker.line.at(700.0, lambda: setattr(worker.line, "open_error", None))
    with caplog.at_level(logging.INFO):
        worker.run(710.0)
    assert [record.getMessage() for record in caplog.records] == [
        "line main: /dev/rs485: no such device",
        "line main: /dev/rs485 is open",
        "line main station 1 (s1): online: DIO100",
    ]
    assert all(record.line == "main" for record in caplog.records)  # type: ignore[attr-defined]  # an extra
