"""Modules that do not answer: the others and their commands go on, and they are found again."""

import logging
from collections import Counter
from functools import partial
from itertools import pairwise

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import OutputConfig
from bridge.model import (
    LineProtocol,
    ProblemChanged,
    Reason,
    SettingsRead,
    StationChanged,
    Status,
    ValuesChanged,
    Word,
    Writes,
)

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 103.0
PROTOCOLS = list(LineProtocol)


def test_commands_for_a_dying_module_let_the_others_go_first() -> None:
    """Ten commands for a module that just died: the one for the live module is done in 2 s."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2)))
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", True))
    for n in range(8):
        worker.command_at(T + 0.5, 1 << n, 1 << n, station_id="s1")
    worker.command_at(T + 0.6, 1, 1, station_id="s2", command_id="live")
    worker.run(T + 10)
    live = next(verdict for verdict in worker.verdicts() if verdict.id == "live")
    assert live.status is Status.DONE
    assert live.ms < 2000
    assert len(worker.verdicts()) == 9
    ended = {(v.status, v.reason) for v in worker.verdicts() if v.id != "live"}
    assert ended <= {
        (Status.UNKNOWN, Reason.NO_REPLY),
        (Status.REFUSED, Reason.EXPIRED),
        (Status.REFUSED, Reason.OFFLINE),
    }


def test_what_expires_behind_a_module_that_dies_is_refused_then() -> None:
    """A verdict is due within the deadline and one write (promise 3), whatever else is ordered."""
    outputs = tuple(OutputConfig(n, max_on_s=10.0 if n < 4 else None) for n in range(1, 9))
    worker = VirtualWorker(make_line(make_station(outputs=outputs), baud=4800, writes=Writes.WISCO))
    worker.line.modules[1].write_outputs(0b111, 0b111, b"")
    worker.line.at(T - 0.5, lambda: setattr(worker.line.modules[1], "away", True))
    for n in range(4, 8):
        worker.command_at(T + 0.5, 1 << n, 1 << n, command_id=f"{n}")
    worker.run(T + 15)
    told = [verdict.ms for verdict in worker.verdicts() if verdict.by is None]
    assert len(told) == 4
    assert max(told) < 2000 + 2200


def test_what_expires_in_the_queue_is_refused_before_its_turn() -> None:
    """Forty toggles wait before it, for four seconds: it is refused at its deadline of 0.5 s."""
    worker = VirtualWorker()
    for _ in range(40):
        worker.command_at(T, 1, word=Word.TOGGLE, deadline_s=10.0)
    worker.command_at(T, 2, word=Word.TOGGLE, deadline_s=0.5, command_id="late")
    worker.run(T + 12)
    late = next(verdict for verdict in worker.verdicts() if verdict.id == "late")
    assert (late.status, late.reason) == (Status.REFUSED, Reason.EXPIRED)
    assert 500 <= late.ms < 800


def test_commands_for_the_only_module_do_not_spin_while_it_is_dying() -> None:
    """Nothing is due and no other module waits: they are carried out, each with its verdict."""
    worker = VirtualWorker()
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", True))
    for n in range(8):
        worker.command_at(T + 0.5, 1 << n, 1 << n, deadline_s=10.0)
    worker.run(T + 15)
    assert len(worker.verdicts()) == 8


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_commands_for_a_silent_module_do_not_keep_it_online(protocol: LineProtocol) -> None:
    """Offline within 5 s, however many commands come (promise 7): what they ask counts too."""
    worker = VirtualWorker(make_line(protocol=protocol, baud=4800))
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", True))
    for n in range(40):
        worker.command_at(T + 0.3 * n, 1 << n % 8, 0, word=Word.TOGGLE)
    worker.run(T + 12)
    (offline_at,) = [at for at, online in worker.online_at() if not online]
    assert T + 2 <= offline_at <= T + 5


def test_modules_that_were_dead_since_the_start_hold_a_line_for_one_time_out_each() -> None:
    """Probes in vain delay the others by no more, though station 0 takes no Modbus frames."""
    worker = VirtualWorker(make_line(*(make_station(n) for n in range(32)), baud=57600))
    for address in (5, 15):
        worker.line.modules[address].away = True
    worker.run(T + 80)
    wire = [(at, int(frame[1:3], 16), frame[:1]) for at, frame in worker.line.wire if at >= T]
    longest = Counter[bool]()
    for (at, address, _), (later, *_) in pairwise(wire):
        probed = address in {5, 15}
        longest[probed] = max(longest[probed], round((later - at) * 1000))
    assert longest[True] <= 115
    assert longest[False] <= 20
    probes = [mark for _, address, mark in wire if address in {5, 15}]
    assert probes.count(b"#") <= 6  # these make the reads slower for the late window


@pytest.mark.parametrize("back_s", [0.3, 2.0, 9.0, 20.0, 35.0, 70.0])
def test_a_module_that_takes_wisco_frames_alone_is_found_within_30_s(back_s: float) -> None:
    """It was dead since the start, so what it takes is not known."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2)))
    module = worker.line.modules[2]
    module.wisco_only = module.away = True
    worker.line.at(100.0 + back_s, lambda: setattr(module, "away", False))
    worker.run(100.0 + back_s + 32.0)
    ((came_at, online),) = worker.online_at("s2")
    assert online
    assert 0.0 < came_at - 100.0 - back_s <= 31.0  # with the reads of the contact


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
@pytest.mark.parametrize(("baud", "most_s"), [(57600, 45.0), (4800, 60.0)])
def test_dead_modules_take_a_tenth_of_a_wisco_line_and_are_found_again(
    baud: int, most_s: float
) -> None:
    """Of 32 modules 31 die: what is asked in vain is limited (promise 7), docs/failures.md D1."""
    worker = VirtualWorker(make_line(*(make_station(n) for n in range(1, 32)), baud=baud))
    modules = worker.line.modules
    for n in range(2, 32):
        worker.line.at(T, partial(setattr, modules[n], "away", True))
    back_at = T + 100.0
    worker.line.at(back_at, lambda: setattr(modules[9], "away", False))
    worker.run(back_at + most_s)
    asked = [(at, int(frame[1:3], 16)) for at, frame in worker.line.wire]
    vain_s = sum(
        later - at
        for (at, address), (later, _) in pairwise(asked)
        if T + 20 <= at < back_at and address != 1
    )
    watched_s = back_at - T - 20
    assert 0.05 * watched_s < vain_s <= 0.1 * watched_s + 0.2  # one probe begins at its end
    living = [at for at, address in asked if T + 20 <= at < back_at and address == 1]
    assert max(later - at for at, later in pairwise(living)) < 0.2 + 80 * 10 / baud
    assert any(at > back_at for at, online in worker.online_at("s9") if online)


def test_a_dead_module_delays_nobody_and_is_met_when_it_comes() -> None:
    """Nothing of it is published before its first good read."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2)))
    worker.line.modules[1].away = True
    worker.line.at(T, lambda: setattr(worker.line.modules[1], "away", False))
    worker.run(T + 35)
    assert worker.online_at("s2")[0][0] < 101.0
    ((came_at, online),) = worker.online_at("s1")
    assert online
    assert T < came_at < T + 30


def test_a_silent_module_goes_offline_and_comes_back() -> None:
    """Its last states stay as they were; coming back, it is read anew before it is online."""
    worker = VirtualWorker()
    module = worker.line.modules[1]
    worker.line.at(T, lambda: setattr(module, "away", True))
    worker.line.at(T + 8, lambda: module.set_input(1, True))
    worker.line.at(T + 8, lambda: setattr(module, "away", False))
    worker.run(T + 20)
    problem, gone, *back = worker.reported(T)
    assert problem == ProblemChanged("s1", "no_reply", "station 1 did not answer")
    assert isinstance(gone, StationChanged)
    assert (gone.station_id, gone.online) == ("s1", False)
    assert "did not answer" in gone.detail
    assert [type(event) for event in back] == [
        SettingsRead,
        ValuesChanged,
        ProblemChanged,
        StationChanged,
    ]
    assert back[1] == ValuesChanged("s1", 1, 0)
    assert back[2] == ProblemChanged("s1", None, "")
    (_, (gone_at, _), (back_at, _)) = worker.online_at()
    assert 2.0 <= gone_at - T <= 5.0
    assert back_at - (T + 8) <= 8.0


def test_a_cut_cable_takes_every_module_offline() -> None:
    """All within 5 s, each with its own words; then they come back one after the other."""
    worker = VirtualWorker(make_line(*[make_station(n) for n in range(1, 13)]))
    for module in worker.line.modules.values():
        worker.line.at(T, lambda module=module: setattr(module, "away", True))  # type: ignore[misc]  # a lambda with a default
        worker.line.at(T + 20, lambda module=module: setattr(module, "away", False))  # type: ignore[misc]  # as above
    worker.run(T + 60)
    gone = [e for e in worker.reported(T) if isinstance(e, StationChanged) and not e.online]
    assert {event.station_id for event in gone} == {f"s{n}" for n in range(1, 13)}
    for n in range(1, 13):
        (_, (gone_at, _), (_, online)) = worker.online_at(f"s{n}")
        assert gone_at - T <= 5.0
        assert online
    for event in gone:
        assert event.detail in {
            f"station {event.station_id[1:]} did not answer",
            "no module on the line answers",
        }


@pytest.mark.parametrize("lost", [3, 4])
def test_a_contact_that_loses_a_reply_is_repeated_soon(lost: int) -> None:
    """A module answers its probe, and a later reply of this contact is lost: it is back in 5 s."""
    worker = VirtualWorker(
        make_line(make_station(1), make_station(2), protocol=LineProtocol.MODBUS_RTU)
    )
    asked: list[float] = []

    def fault(frame: bytes) -> Fault | None:
        if frame[0] != 2 or worker.line.modules[2].away:
            return None
        asked.append(worker.line.now)
        return Fault.LOSE_REPLY if len(asked) == lost and asked[0] > T else None

    def set_away(away: bool) -> None:
        worker.line.modules[2].away = away
        asked.clear()

    worker.line.fault = fault
    worker.line.at(T, lambda: set_away(True))
    worker.line.at(T + 40, lambda: set_away(False))
    worker.run(T + 75)
    back = [at for at, online in worker.online_at("s2") if online and at > T + 40]
    assert back[0] - asked[0] < 5


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
def test_a_dead_module_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    """One line a transition, not one a miss (docs/failures.md E3)."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2), baud=4800))
    worker.line.modules[1].away = True
    with caplog.at_level(logging.INFO):
        worker.run(100.0 + 200)
    assert [record.getMessage() for record in caplog.records] == [
        "line main: /dev/rs485 is open",
        "line main station 1 (s1): offline: station 1 did not answer",
        "line main station 2 (s2): online: DIO100",
    ]
