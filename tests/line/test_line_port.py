"""The states of a line and its modules when a gateway comes and goes."""

import logging

import pytest
from support.gateway_line import CLOSED, GatewayWorker
from support.virtual_worker import make_line, make_station

from bridge.config.schema import OutputConfig
from bridge.line.errand import Errand
from bridge.model import DO100, LineProtocol, Reason, ValuesChanged
from bridge.simulator.module import SimulatedModule

pytestmark = pytest.mark.warns  # what goes wrong here is logged

T = 120.0
DAY_S = 24 * 3600.0


def worker_of(stations: int = 2, protocol: LineProtocol = LineProtocol.WISCO) -> GatewayWorker:
    """DIO100s behind a gateway."""
    return GatewayWorker(make_line(*map(make_station, range(1, stations + 1)), protocol=protocol))


def switch_off(worker: GatewayWorker) -> None:
    """The panel has no power."""
    for module in worker.line.modules.values():
        module.away = True


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_a_connection_that_is_dropped_is_opened_again_before_it_is_told(
    protocol: LineProtocol, caplog: pytest.LogCaptureFixture
) -> None:
    """The modules are met anew, as strangers, and what changed meanwhile is told at once."""
    worker = worker_of(protocol=protocol)
    worker.gateway.drop_after_s = 3.0
    for n in range(30):
        worker.line.at(T + n * 7, lambda: worker.line.modules[2].toggle_input(5))
    with caplog.at_level(logging.WARNING):
        worker.run(T + 210)
    assert worker.told_of_line() == [(worker.told_of_line()[0][0], True)]
    assert [len(worker.online_at(s)) for s in ("s1", "s2")] == [1, 1]
    assert len([e for e in worker.reported(T) if isinstance(e, ValuesChanged)]) >= 30
    assert len(worker.line.opened) > 60
    assert worker.writes() == []
    texts = [record.getMessage() for record in caplog.records]
    assert texts == [f"line main: {CLOSED} (it is opened again at once)"]


def test_a_gateway_that_stays_away_takes_its_modules_offline_in_time() -> None:
    """Within 5 s; they are back when it is."""
    worker = worker_of()

    def fall() -> None:
        worker.gateway.drop_after_s = 0.0
        worker.line.open_error = "refused"

    def rise() -> None:
        worker.gateway.drop_after_s = float("inf")
        worker.line.open_error = None

    worker.line.at(T, fall)
    worker.line.at(T + 30, rise)
    worker.run(T + 40)
    for told in (worker.told_of_line(), worker.online_at("s1"), worker.online_at("s2")):
        assert [online for _, online in told] == [True, False, True]
        assert 2.0 < told[1][0] - T < 5.0
        assert told[2][0] - (T + 30) < 5.0


def test_commands_while_it_is_opened_again_are_refused() -> None:
    """None is carried out later; the next one is done."""
    worker = worker_of()
    worker.line.at(T, lambda: setattr(worker.gateway, "drop_after_s", 1.0))
    worker.line.at(T + 0.1, lambda: setattr(worker.gateway, "drop_after_s", float("inf")))
    worker.command_at(T + 0.2, 1, 1, command_id="now")
    worker.command_at(T + 3.0, 2, 2, command_id="then")
    worker.run(T + 5)
    assert [(v.id, v.reason) for v in worker.verdicts()] == [
        ("now", Reason.OFFLINE),
        ("then", None),
    ]
    assert worker.line.modules[1].outputs == 2


def test_another_model_behind_the_new_connection_is_found_out() -> None:
    """Another model behind the new connection is offline at once, with no old values."""
    worker = worker_of()

    def exchange() -> None:
        worker.line.modules[1] = SimulatedModule(DO100, 1, clock=worker.line.clock)
        worker.gateway.drop_after_s = 1.0

    worker.line.at(T, exchange)
    worker.line.at(T + 0.1, lambda: setattr(worker.gateway, "drop_after_s", float("inf")))
    worker.run(T + 20)
    assert [online for _, online in worker.online_at("s1")] == [True, False]
    assert [online for _, online in worker.online_at("s2")] == [True]
    assert worker.online_at("s1")[1][0] - T < 2.0


def test_a_module_that_is_not_found_again_is_told() -> None:
    """The other one is there without a word."""
    worker = worker_of()

    def lose() -> None:
        worker.line.modules[1].away = True
        worker.gateway.drop_after_s = 1.0

    worker.line.at(T, lose)
    worker.line.at(T + 0.1, lambda: setattr(worker.gateway, "drop_after_s", float("inf")))
    worker.run(T + 20)
    assert [online for _, online in worker.online_at("s1")] == [True, False]
    assert [online for _, online in worker.online_at("s2")] == [True]
    assert worker.online_at("s1")[1][0] - T < 5.0
    assert [online for _, online in worker.told_of_line()] == [True]


def test_a_panel_that_is_off_makes_no_noise(caplog: pytest.LogCaptureFixture) -> None:
    """A gateway that closes its idle connection every 10 s causes no log lines (F19).

    It is opened when a module has to be asked, and modules are contacted when they are on.
    """
    worker = worker_of()
    worker.gateway.idle_s = 10.0
    worker.line.at(T, lambda: switch_off(worker))
    back_at = T + DAY_S / 12

    def switch_on() -> None:
        for module in worker.line.modules.values():
            module.away = False

    worker.line.at(back_at, switch_on)
    with caplog.at_level(logging.INFO):
        worker.run(back_at + 60)
    assert [online for _, online in worker.told_of_line()] == [True]
    assert [online for _, online in worker.online_at("s2")] == [True, False, True]
    assert worker.online_at("s2")[2][0] - back_at < 35.0
    quiet = [r for r in caplog.records if "online: " not in r.getMessage()]
    assert len(quiet) == 1 + 2 + 1  # the port is open; a line a module; and what it may be
    assert "no module answers on tcp://gateway:4196, and it is opened anew" in quiet[3].getMessage()
    assert "not Modbus TCP" in quiet[3].getMessage()


def test_a_connection_at_rest_is_opened_for_an_errand() -> None:
    """A connection at rest is opened at once for an errand."""
    worker = worker_of(1)
    worker.gateway.idle_s = 3.0
    done_at: list[float] = []
    errand = Errand("main", 1, lambda *_: {}, lambda _: done_at.append(worker.line.now))
    worker.line.at(T, lambda: switch_off(worker))
    asked_at = [T + 3600.0 + 3 * n for n in range(10)]  # some of these while it is at rest
    for instant in asked_at:
        worker.line.at(instant, lambda: worker.worker.ask(errand))
    worker.run(T + 3700)
    assert done_at == pytest.approx(asked_at, abs=0.3)


@pytest.mark.parametrize("back_s", [33.0, 38.0, 43.0, 75.0, 90.0])
def test_a_connection_does_not_rest_while_an_output_is_overdue(back_s: float) -> None:
    """A module that was away meanwhile is told OFF within 2 s of its return (F3)."""
    outputs = (OutputConfig(1, max_on_s=30.0),)
    worker = GatewayWorker(make_line(make_station(outputs=outputs)))
    module = worker.line.modules[1]
    worker.gateway.idle_s = 10.0
    seen: list[int] = []
    worker.line.at(T - 1, lambda: module.set_output(1, True))
    worker.line.at(T + 10, lambda: switch_off(worker))
    worker.line.at(T + back_s, lambda: setattr(module, "away", False))
    worker.line.at(T + back_s + 2.0, lambda: seen.append(module.outputs))
    worker.run(T + back_s + 3.0)
    assert seen == [0]


@pytest.mark.parametrize("stations", [1, 31])
def test_a_connection_that_went_deaf_is_opened_anew(stations: int) -> None:
    """When all modules fall silent, a new connection is opened within 15 s (F20)."""
    worker = worker_of(stations, LineProtocol.MODBUS_RTU)
    worker.line.at(T, lambda: setattr(worker.gateway, "deaf_before", T))
    worker.run(T + 15)
    assert [online for _, online in worker.told_of_line()] == [True]
    for n in range(1, stations + 1):
        assert [online for _, online in worker.online_at(f"s{n}")] == [True, False, True]
    assert len(worker.line.opened) == 2


def test_a_change_over_a_gateway_is_confirmed_in_a_frame_that_says_whose_it_is() -> None:
    """Two programs may be let in, and then each gets the replies of both (F12)."""
    worker = worker_of(1)
    worker.line.at(T, lambda: worker.line.modules[1].toggle_input(4))
    worker.run(T + 1)
    frames = [frame for at, frame in worker.line.wire if at >= T]
    confirmed = [frame for frame in frames if frame.startswith(b":0102")]
    assert len(confirmed) == 1
    assert frames[frames.index(confirmed[0]) - 1] == b"#01RDIH\r"
    assert len([e for e in worker.reported(T) if isinstance(e, ValuesChanged)]) == 1
