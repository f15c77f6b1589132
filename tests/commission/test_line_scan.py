"""The requests and reports of a scan of a line in use, in virtual time."""

from dataclasses import replace
from typing import Any

import pytest
from support.virtual_panel import VirtualPanel
from support.virtual_worker import make_line, make_station

from bridge.commission.asker import Asker
from bridge.commission.line_scan import LineScan
from bridge.commission.survey import STATIONS, THOROUGH
from bridge.line.errand import SHARE
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.module import SimulatedModule
from bridge.transport.timing import LineTiming


class Scanned:
    """A line with one configured module and a stranger, and a scan of it.

    Attributes:
        told: How far it was, one after the other.
        result: What came of it.
    """

    def __init__(
        self, protocol: LineProtocol, stations: range | list[int], *, thorough: bool = False
    ) -> None:
        line = make_line(make_station(1), protocol=protocol)
        modules = [SimulatedModule(DIO100, 1), SimulatedModule(DO100, 9)]
        self.panel = VirtualPanel(protocol, line.baud, modules)
        self.scan = LineScan(line, stations, thorough=thorough)
        time, timing = self.panel.time, LineTiming.from_config(line)
        self._asker = Asker(
            self.panel.open(line.baud),
            replace(timing, silence_s=max(timing.silence_s, 0.03)),
            clock=time.clock,
            sleep=time.sleep,
        )
        self.told: list[Any] = []
        self.result: Any = None

    def run(self) -> None:
        """Scans; no frame writes."""
        self.result = self.scan.run(self._asker, self.told.append)
        assert not [frame for _, frame in self.panel.sent if is_write(frame)]


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_configured_and_strange_modules_are_told_apart(protocol: LineProtocol) -> None:
    """By the id of the station; and before each address it is told how far it is."""
    scanned = Scanned(protocol, range(12))
    scanned.run()
    found = scanned.result["found"]
    assert [(one["address"], one["model"], one["id"]) for one in found] == [
        (1, "DIO100", "s1"),
        (9, "DO100", None),
    ]
    asked = 12 if protocol is LineProtocol.WISCO else 11  # 0 is everybody in Modbus
    assert [told["progress"] for told in scanned.told] == [
        round(n / asked, 3) for n in range(asked)
    ]
    assert (scanned.result["progress"], scanned.result["line"]) == (1.0, "main")
    assert [len(told["found"]) for told in scanned.told][-1] == 2


def test_a_thorough_scan_asks_who_is_silent_again() -> None:
    """One whose first replies are lost is found in a later round, and none is found twice."""
    scanned = Scanned(LineProtocol.MODBUS_RTU, [1, 9, 9], thorough=True)
    scanned.panel.faults.set(FaultKind.SILENT, address=9, times=THOROUGH.tries - 1)
    scanned.run()
    assert [one["address"] for one in scanned.result["found"]] == [1, 9]
    assert len(scanned.told) == 2 * THOROUGH.tries


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_the_time_that_it_takes_is_foretold(protocol: LineProtocol) -> None:
    """Time-outs alone, made longer by the share that others have."""
    scanned = Scanned(protocol, [3, 4, 5])
    began = scanned.panel.time.now
    scanned.run()
    alone_s = scanned.panel.time.now - began
    late_s = 3 * 0.3 if protocol is LineProtocol.WISCO else 0.0  # on the line it has to pass
    assert scanned.scan.total_s == pytest.approx((alone_s + late_s) / SHARE, rel=0.15)
    assert LineScan(make_line(protocol=protocol), STATIONS, thorough=True).total_s > 60
