"""Errands between polls, and telling what passes, on the real bus in virtual time."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, cast

import pytest
from support.bus_worker import BusWorker
from support.virtual_worker import make_line, make_station

from bridge.drivers import driver_for
from bridge.errors import BridgeError, NoReplyError
from bridge.line.errand import SHARE, EndErrand, Errand, ErrandTold, SharedLine, Tell, Trace
from bridge.model import DIO100, DO100, LinePassed, LineProtocol
from bridge.simulator.faults import FaultKind

pytestmark = pytest.mark.warns  # what goes wrong here is logged

NOBODY = 9
MET = 103.0  # by then every station was met
END = 140.0
ASKED = 20

Work = Callable[[SharedLine, Tell], Mapping[str, Any]]


class ErrandWorker(BusWorker):
    """A worker that is given errands.

    Attributes:
        told: What they said, with the instant.
    """

    def __init__(self, protocol: LineProtocol = LineProtocol.WISCO) -> None:
        self.told: list[tuple[float, ErrandTold]] = []
        super().__init__(make_line(make_station(1), make_station(2, DO100), protocol=protocol))

    def errand_at(self, instant: float, work: Work) -> None:
        """Has an errand arrive at `instant`."""
        errand = Errand("main", 7, work, lambda told: self.told.append((self.line.now, told)))
        self.line.at(instant, lambda: self.worker.ask(errand))

    def ended(self) -> ErrandTold:
        """The last word of the one errand."""
        (ended,) = [told for _, told in self.told if told.ended]
        assert ended is self.told[-1][1]
        return ended

    def asked(self) -> list[float]:
        """Return the instants at which the errand asked the missing station."""
        request = request_to_nobody(self.config.protocol).frame
        return [at for at, frame in self.line.wire if frame == request]


def request_to_nobody(protocol: LineProtocol) -> Any:
    """A read of a station that is not there."""
    return driver_for(protocol, NOBODY, DIO100).read_inputs


def asking(protocol: LineProtocol, times: int = ASKED) -> Work:
    """An errand that asks in vain."""

    def work(line: SharedLine, tell: Tell) -> Mapping[str, Any]:
        for turn in range(times):
            tell({"turn": turn})
            with pytest.raises(NoReplyError):
                line.exchange(
                    request_to_nobody(protocol), protected=protocol is not LineProtocol.WISCO
                )
            assert line.strays() == b""
        return {"turn": times}

    return work


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_an_errand_has_its_share_and_no_more(protocol: LineProtocol) -> None:
    """With the silence that it leaves behind; polls fill the rest."""
    worker = ErrandWorker(protocol)
    worker.errand_at(MET, asking(protocol))
    worker.run(END)
    assert worker.ended().data == {"turn": ASKED}
    assert [told.data for _, told in worker.told[:-1]] == [{"turn": n} for n in range(ASKED)]
    asked = worker.asked()
    assert len(asked) == ASKED
    periods = [later - at for at, later in pairwise(asked)]
    quiet_s = 0.3 if protocol is LineProtocol.WISCO else 0.0
    cost_s = 0.1 + quiet_s  # at the least: its bytes take some more
    assert min(periods) >= cost_s / SHARE
    assert max(periods) < 2 * cost_s / SHARE
    between = [at for at, _ in worker.line.wire if asked[0] < at < asked[1]]
    assert len(between) > 10


def test_others_go_on_while_a_station_may_yet_say_something_late() -> None:
    """While a late reply of one station may come, other stations are read."""
    now = 100.0

    class Bus:
        """Station 9 may speak late until 100.5; it tells when it is asked."""

        quiet_until = 0.0

        def free_at(self, address: int, **_: bool) -> float:
            return {NOBODY: 100.5}[address]

        def exchange_apart(self, _request: Any, *, protected: bool) -> float:
            assert protected
            return now

    def turn() -> bool:
        nonlocal now
        now += 0.02
        return False

    line = SharedLine(cast("Any", Bus()), turn, lambda: now)
    asked_at = line.exchange(request_to_nobody(LineProtocol.MODBUS_RTU), protected=True)
    assert 100.5 <= asked_at < 100.53


def test_a_command_waits_for_one_exchange(worker: ErrandWorker) -> None:
    """A command during an errand waits for one exchange, and comes before the others."""
    worker.errand_at(MET, asking(LineProtocol.WISCO))
    for number in range(10):
        worker.command_at(MET + 0.05 + number * 0.83, 1, number % 2)
    worker.run(END)
    assert {verdict.status for verdict in worker.verdicts()} == {"done"}
    # Time-out and late window of the errand's exchange, one poll, and the command's own exchanges.
    assert max(verdict.ms for verdict in worker.verdicts()) < 700


def test_an_errand_waits_for_nobody_where_nothing_is_due(worker: ErrandWorker) -> None:
    """While every module is away the line is its own."""
    for module in worker.line.modules.values():
        module.away = True
    worker.errand_at(120.0, asking(LineProtocol.WISCO))
    worker.run(END)
    asked = worker.asked()
    took_s = asked[-1] - asked[0]
    assert took_s < ASKED * 0.45 / SHARE / 2
    assert worker.ended().error is None


def test_an_error_ends_it_and_nothing_else(worker: ErrandWorker) -> None:
    """The line works on."""

    def work(_line: SharedLine, _tell: Tell) -> Mapping[str, Any]:
        raise BridgeError("the EEPROM is worn out")

    worker.errand_at(MET, work)
    worker.command_at(MET + 1.0, 1, 1)
    worker.run(MET + 3.0)
    assert worker.ended().error == "the EEPROM is worn out"
    assert worker.verdict().status == "done"


def test_a_stop_ends_it(worker: ErrandWorker) -> None:
    """Before its next exchange, and what waits behind it too."""
    worker.errand_at(MET, asking(LineProtocol.WISCO))
    worker.errand_at(MET + 0.1, asking(LineProtocol.WISCO))
    worker.run(MET + 5.0)
    ended = [told for _, told in worker.told if told.ended]
    assert [told.error for told in ended] == ["line main is being stopped"] * 2
    assert worker.line.now < MET + 5.5


def test_one_that_is_not_wanted_any_more_ends(worker: ErrandWorker) -> None:
    """Before its next exchange; another ticket is another errand's."""
    worker.errand_at(MET, asking(LineProtocol.WISCO))
    worker.line.at(MET + 2.0, lambda: worker.worker.ask(EndErrand(6)))
    worker.line.at(MET + 5.0, lambda: worker.worker.ask(EndErrand(7)))
    worker.run(END)
    assert worker.ended().error == "it was stopped by a request"
    assert MET + 5.0 < worker.told[-1][0] < MET + 5.5
    assert worker.asked()[-1] > MET + 2.5


def test_a_port_that_goes_ends_it(worker: ErrandWorker) -> None:
    """A lost port ends an errand; without a port another is refused; later one works."""
    worker.errand_at(MET, asking(LineProtocol.WISCO))
    worker.line.at(MET + 2.0, lambda: _hang_up(worker))
    worker.errand_at(MET + 3.0, asking(LineProtocol.WISCO))
    worker.line.at(MET + 4.0, lambda: setattr(worker.line, "open_error", None))
    worker.errand_at(MET + 8.0, asking(LineProtocol.WISCO, times=1))
    worker.run(END)
    errors = [told.error for _, told in worker.told if told.ended]
    assert errors == [
        "the port is gone",
        "line main has no port: it is gone, or cannot be opened",
        None,
    ]


def _hang_up(worker: ErrandWorker) -> None:
    worker.bus_line.faults.set(FaultKind.HANG_UP, times=1)
    worker.line.open_error = "no such device"


def test_what_passes_is_told_while_somebody_wants_to_know(worker: ErrandWorker) -> None:
    """Every byte in its order, over a port that comes back; and none before or after."""
    heard: list[LinePassed] = []
    worker.line.at(MET, lambda: worker.worker.ask(Trace(heard.append)))
    worker.line.at(MET + 1.0, lambda: _hang_up(worker))
    worker.line.at(MET + 2.0, lambda: setattr(worker.line, "open_error", None))
    worker.line.at(MET + 6.0, lambda: worker.worker.ask(Trace(None)))
    worker.run(MET + 7.0)
    sent = [passed.data for passed in heard if passed.sent]
    wire = [frame for _, frame in worker.line.wire]
    starts = range(len(wire) - len(sent) + 1)
    assert any(wire[at : at + len(sent)] == sent for at in starts)
    assert MET < heard[0].at < MET + 0.5
    assert MET + 5.0 < heard[-1].at < MET + 6.5
    assert {passed.line for passed in heard} == {"main"}
    assert any(not passed.sent for passed in heard)


def test_a_trace_begins_in_the_middle_of_an_errand(worker: ErrandWorker) -> None:
    """A trace that begins during an errand shows its requests."""
    heard: list[LinePassed] = []
    worker.errand_at(MET, asking(LineProtocol.WISCO))
    worker.line.at(MET + 2.0, lambda: worker.worker.ask(Trace(heard.append)))
    worker.run(MET + 10.0)
    frame = request_to_nobody(LineProtocol.WISCO).frame
    assert frame in [passed.data for passed in heard if passed.sent]


@pytest.fixture
def worker() -> ErrandWorker:
    """A Wisco line with two modules."""
    return ErrandWorker()
