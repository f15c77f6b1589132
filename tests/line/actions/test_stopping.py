"""The end of a line whose motors run, on the wire: at SIGTERM, or a reload that changes it."""

import logging
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import inf

import pytest
from support.moving_line import MET_BY_S, MOVE_AT_S, MovingLine, moving_line, moving_station

from bridge.drivers import driver_for
from bridge.errors import ExchangeError
from bridge.line.errand import Errand, ErrandTold, SharedLine, Tell
from bridge.line.rules.halt import BUDGET_S, PATIENCE_S
from bridge.model import (
    DIO100,
    DO100,
    Command,
    CoverCommand,
    LeftCover,
    LineProtocol,
    Reason,
    Writes,
)
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.module import SimulatedModule

pytestmark = pytest.mark.warns  # what goes wrong here is logged

PROTOCOLS = list(LineProtocol)
STOP_AT = MET_BY_S + 1.0
SLOW_S = 1.0  # a time-out that gateways may need


def _line(
    protocol: LineProtocol = LineProtocol.WISCO,
    live: int = 1,
    dead: int = 0,
    timeout_s: float | None = None,
    writes: Writes = Writes.AUTO,
) -> MovingLine:
    """A DIO100 or more that live, and DO100s to fall silent; all their motors run."""
    stations = [moving_station(n + 1, DIO100) for n in range(live)]
    stations += [moving_station(live + n + 1, DO100) for n in range(dead)]
    return MovingLine(replace(moving_line(stations, protocol, timeout_s), writes=writes))


def _writes(worker: MovingLine, since: float = STOP_AT) -> list[bytes]:
    return [frame for at, frame in worker.line.wire if is_write(frame) and at >= since]


def _off_s(worker: MovingLine, address: int = 1) -> float:
    """How long after the stop the motors of a module stood."""
    off_at = worker.off_at(address)
    assert off_at is not None
    return off_at - STOP_AT


def _hang_up(worker: MovingLine, at: float, back_at: float = inf) -> None:
    worker.line.at(at, lambda: setattr(worker.bus_line, "hung_up", True))
    worker.line.at(back_at, lambda: setattr(worker.bus_line, "hung_up", False))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_all_motors_of_a_module_go_off_in_one_frame(protocol: LineProtocol) -> None:
    """Four that move are one write, and one look at it."""
    worker = _line(protocol)
    worker.run(STOP_AT)
    assert worker.line.modules[1].outputs == 0
    assert len(_writes(worker)) == 1
    assert worker.worker.moving == ()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_outputs_that_are_no_covers_keep_what_they_have(protocol: LineProtocol) -> None:
    """A lamp that lies between two covers is not switched by their end."""
    config = moving_station(1, DIO100)
    first, _, third, _ = config.covers
    config = replace(config, covers=(first, third), interlock=(first.outputs, third.outputs))
    worker = MovingLine(moving_line([config], protocol))
    worker.line.at(MOVE_AT_S + 1, lambda: worker.line.modules[1].set_output(3, True))
    worker.run(STOP_AT)
    assert worker.line.modules[1].outputs == 0b100
    ordered = {s.output for s in worker.line.modules[1].switchings if s.frame}
    assert not ordered & {3, 4, 7, 8}


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_both_directions_that_a_hand_switched_on_go_off(protocol: LineProtocol) -> None:
    """Seen or not seen before the stop: the read after OFF tells."""
    worker = _line(protocol)
    worker.line.at(STOP_AT - 0.01, lambda: worker.line.modules[1].set_output(2, True))
    worker.run(STOP_AT)
    assert worker.line.modules[1].outputs == 0
    assert worker.worker.moving == ()


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("silent_s", [0.0, 0.2, 1.0])
def test_orders_to_modules_that_do_not_answer_keep_no_live_motor_on(
    protocol: LineProtocol, silent_s: float
) -> None:
    """Commands, `max_on` and ways that are over at dead modules are cut short at the stop."""
    worker = _line(protocol, live=1, dead=2, timeout_s=SLOW_S)
    worker.away_at(STOP_AT - silent_s, [2, 3])
    for n in range(8):
        stop = CoverCommand(
            "s2",
            "cover/c1",
            "STOP",
            "c1",
            3,
            None,
            arrived=STOP_AT,
            deadline=STOP_AT + 2.0,
            id=f"{n}",
        )
        worker.line.at(STOP_AT - 0.05 * n, partial(worker.worker.submit, stop))
    worker.run(STOP_AT)
    assert _off_s(worker) < 3.0
    assert worker.line.now - STOP_AT < BUDGET_S + 2.0


def test_what_waits_is_refused_when_the_stop_begins_and_not_when_it_ends() -> None:
    """A command in its dead time, and one for a module that is silent: verdicts at once."""
    worker = _line(live=1, dead=2)
    worker.away_at(STOP_AT - 0.2, [2, 3])
    turn = CoverCommand(
        "s1", "cover/c1", "CLOSE", "c1", 3, 0, arrived=STOP_AT, deadline=STOP_AT + 2.0, id="turn"
    )
    worker.line.at(STOP_AT - 0.4, partial(worker.worker.submit, turn))
    worker.run(STOP_AT)
    ((told_at, verdict),) = [(at, e) for at, e in worker.events if getattr(e, "id", None) == "turn"]
    assert getattr(verdict, "reason", None) is Reason.STOPPING
    assert told_at - STOP_AT < 0.5
    assert worker.line.modules[1].outputs == 0


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_contact_under_way_is_finished_and_what_it_found_running_is_stopped(
    protocol: LineProtocol,
) -> None:
    """At any moment of it: the module was away while the motor ran."""
    for moment in range(12):
        worker = _line(protocol)
        worker.away_at(MET_BY_S, [1])
        worker.away_at(MET_BY_S + 4.0, [1], away=False)
        met: list[float] = []

        def note_contact(worker: MovingLine = worker, met: list[float] = met) -> None:
            met.append(worker.line.now)

        worker.line.at(MET_BY_S + 4.0, note_contact)
        worker.run(MET_BY_S + 4.0 + 0.1 * moment)
        assert worker.line.modules[1].outputs == 0, moment
        assert worker.worker.moving == ()


def _asks_in_vain(line: SharedLine, _: Tell) -> Mapping[str, object]:
    while True:
        with pytest.raises(ExchangeError):
            line.exchange(
                driver_for(LineProtocol.WISCO, 9, DIO100).read_inputs,
                protected=False,
            )


def test_an_errand_under_way_ends_and_the_motors_stand() -> None:
    """A scan that asks addresses where nobody is."""
    worker = _line()
    told: list[ErrandTold] = []
    errand = Errand("main", 1, _asks_in_vain, told.append)
    worker.line.at(STOP_AT - 2.0, partial(worker.worker.ask, errand))
    worker.run(STOP_AT)
    assert _off_s(worker) < 1.5
    assert told[-1].error == "line main is being stopped"


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_port_that_was_gone_before_is_opened_again(protocol: LineProtocol) -> None:
    """The stop comes while the worker waits with the port closed."""
    worker = _line(protocol)
    _hang_up(worker, STOP_AT - 5.0, STOP_AT + 3.0)
    worker.run(STOP_AT)
    assert 3.0 < _off_s(worker) < 4.0
    assert worker.worker.moving == ()


def test_an_adapter_that_came_back_at_another_line_is_not_written() -> None:
    """A DO100 has the address there: its relays are another program's."""
    worker = _line()
    foreign = SimulatedModule(DO100, 1, clock=worker.line.clock)

    def comes_back() -> None:
        worker.line.modules[1] = foreign
        worker.bus_line.hung_up = False

    _hang_up(worker, STOP_AT - 0.1)
    worker.line.at(STOP_AT + 1.0, comes_back)
    worker.run(STOP_AT)
    assert _writes(worker, STOP_AT - 0.1) == []
    assert len(worker.worker.moving) == 4
    assert worker.line.now - STOP_AT < BUDGET_S


def test_a_port_that_stays_away_is_given_up_in_time_and_its_motors_are_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """One line for each, with line, station and cover."""
    worker = _line()
    _hang_up(worker, STOP_AT - 1.0)
    with caplog.at_level(logging.ERROR):
        worker.run(STOP_AT)
    assert worker.line.now - STOP_AT < BUDGET_S + 0.5
    named = [r.getMessage() for r in caplog.records if "may still move" in r.getMessage()]
    assert [line.startswith("line main station 1 (s1): cover c") for line in named] == [True] * 4
    assert worker.worker.moving == tuple(LeftCover(1, "s1", f"c{n}") for n in (1, 3, 5, 7))


def test_a_line_where_no_motor_runs_ends_at_once_though_its_port_is_gone() -> None:
    """There is nothing to wait for."""
    worker = MovingLine(moving_line([replace(moving_station(1, DIO100), covers=())], PROTOCOLS[0]))
    _hang_up(worker, STOP_AT - 5.0)
    worker.run(STOP_AT)
    assert worker.line.now - STOP_AT < 0.01


@pytest.mark.parametrize("kind", [FaultKind.SILENT, FaultKind.DEAF, FaultKind.REFUSE])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_an_off_that_is_lost_or_refused_once_is_said_again(
    protocol: LineProtocol, kind: FaultKind
) -> None:
    """To say OFF twice does no harm."""
    worker = _line(protocol)
    faults = worker.bus_line.faults

    def strike_once(frame: bytes) -> bool:
        return is_write(frame) and worker.line.now >= STOP_AT and not faults.struck[kind]

    faults.set(kind, address=1, only=strike_once)
    worker.run(STOP_AT)
    assert faults.struck[kind] == 1
    assert _off_s(worker) < 1.5
    assert worker.worker.moving == ()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_module_that_refuses_is_told_again_until_patience_ends(protocol: LineProtocol) -> None:
    """It answers, and its motor runs on: named, and not for ever."""
    worker = _line(protocol)
    worker.bus_line.faults.set(FaultKind.REFUSE, address=1, only=is_write)
    worker.run(STOP_AT)
    assert 5 < len(_writes(worker)) < 15
    assert PATIENCE_S <= worker.line.now - STOP_AT < PATIENCE_S + 0.5
    assert len(worker.worker.moving) == 4


def test_a_module_that_takes_no_modbus_is_stopped_in_its_own_frames() -> None:
    """After a port that was gone too: it is asked for Modbus in vain, and then told."""
    for hang_up_s in (0.0, 1.0):
        worker = _line(writes=Writes.AUTO)
        for module in worker.line.modules.values():
            module.wisco_only = True
        if hang_up_s:
            _hang_up(worker, STOP_AT, STOP_AT + hang_up_s)
        worker.run(STOP_AT)
        assert worker.line.modules[1].outputs == 0
        assert worker.worker.moving == ()


def test_a_set_command_that_was_on_its_way_has_its_true_verdict() -> None:
    """The module fell silent in it, and the stop came: sent once, and not known what became."""
    worker = _line(live=1, dead=1)
    worker.away_at(STOP_AT - 0.05, [2])
    lamp = Command(
        "s2", "do/16", "OFF", 1 << 15, 0, None, arrived=STOP_AT, deadline=STOP_AT + 2.0, id="lamp"
    )
    worker.line.at(STOP_AT - 0.04, partial(worker.worker.submit, lamp))
    worker.run(STOP_AT)
    (verdict,) = [v for v in worker.verdicts() if v.id == "lamp"]
    assert str(verdict.status) in {"unknown", "refused"}
    assert _off_s(worker) < 1.0


def test_an_order_of_many_live_modules_is_told_to_all_before_it_is_read_back() -> None:
    """Eight modules, thirty-two motors: all stand within a second."""
    worker = _line(LineProtocol.MODBUS_RTU, live=8)
    worker.run(STOP_AT)
    assert max(_off_s(worker, address) for address in range(1, 9)) < 1.0
    assert len(_writes(worker)) == 8


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_motor_that_the_line_before_could_not_stop_stops_when_its_module_is_back(
    protocol: LineProtocol,
) -> None:
    """It is looked for each second, and has no whole way before it; one that stands is let be."""
    worker = _line(protocol, live=2)
    worker.worker.inherit([LeftCover(1, "s1", "c1"), LeftCover(2, "s2", "c1")])
    worker.line.modules[1].away = True
    worker.away_at(STOP_AT + 20.2, [1], away=False)
    worker.run(STOP_AT + 30.0)
    first, second = (
        [s.at for s in worker.line.modules[n].switchings if s.output == 1 and not s.value]
        for n in (1, 2)
    )
    assert 0.0 < first[0] - (STOP_AT + 20.2) < 1.5
    assert second[0] >= STOP_AT + 30.0


def test_a_motor_that_was_left_by_the_line_before_is_named_again_at_the_next_stop() -> None:
    """Its module never came: the exit status says so."""
    worker = _line(live=2)
    worker.worker.inherit([LeftCover(1, "s1", "c1"), LeftCover(9, "gone", "c1")])
    worker.line.modules[1].away = True
    worker.run(STOP_AT)
    assert worker.worker.moving == (LeftCover(1, "s1", "c1"),)
    assert worker.line.now - STOP_AT < BUDGET_S
