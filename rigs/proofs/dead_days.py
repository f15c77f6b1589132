"""Days in which something stays wrong, in virtual time, in a process of their own.

`dead_days.py HOURS` prints, as JSON, for each fault the most log lines in one hour, and how many
files were opened for writing. An audit hook counts those, and no process gets rid of one again:
hence its own.
"""

import json
import logging
import os
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.module import SimulatedModule

LIVE, DEAD = 1, 2
DAWDLE_S = 0.5  # for each exchange, so that a day has no more of them than are needed
HOUR_S = 3600.0
BEGIN_S = 100.0  # what a virtual line's clock shows at first


def away(worker: VirtualWorker) -> None:
    """The module has no supply."""
    worker.line.modules[DEAD].away = True


def garbles(worker: VirtualWorker) -> None:
    """Damage all replies of the module."""
    _at_dead_one(worker, Fault.GARBLE_REPLY)


def refuses(worker: VirtualWorker) -> None:
    """Make the module refuse every request."""
    _at_dead_one(worker, Fault.REFUSE)


def other_model(worker: VirtualWorker) -> None:
    """A DO100 is where a DIO100 should be."""
    worker.line.modules[DEAD] = SimulatedModule(DO100, DEAD, clock=worker.line.clock)


def no_port(worker: VirtualWorker) -> None:
    """The adapter is not plugged in."""
    worker.line.open_error = "no such device"


FAULTS: tuple[Callable[[VirtualWorker], None], ...] = (
    away,
    garbles,
    refuses,
    other_model,
    no_port,
)


def _at_dead_one(worker: VirtualWorker, fault: Fault) -> None:
    dawdle = worker.line.fault
    worker.line.fault = lambda frame: dawdle(frame) or (fault if frame[0] == DEAD else None)


class _HourlyLog(logging.Handler):
    """Counts lines by the hour of a worker's clock."""

    def __init__(self, worker: VirtualWorker) -> None:
        super().__init__(logging.INFO)
        self.hours: Counter[int] = Counter()
        self._worker = worker

    def emit(self, _record: logging.LogRecord) -> None:
        """Takes one line."""
        self.hours[int((self._worker.line.now - BEGIN_S) // HOUR_S)] += 1


def lines_an_hour(fault: Callable[[VirtualWorker], None], hours: int) -> int:
    """The most log lines in any hour, with a module in order beside the one that is not."""
    stations = [make_station(address, DIO100) for address in (LIVE, DEAD)]
    worker = VirtualWorker(make_line(*stations, protocol=LineProtocol.MODBUS_RTU))

    def dawdle(_frame: bytes) -> None:
        worker.line.advance(worker.line.now + DAWDLE_S)

    worker.line.fault = dawdle
    fault(worker)
    log = _HourlyLog(worker)
    logging.getLogger().addHandler(log)
    worker.run(until=BEGIN_S + hours * HOUR_S)
    logging.getLogger().removeHandler(log)
    return max(log.hours.values())


def main(hours: int) -> None:
    """Runs one such time for each fault."""
    writes = 0

    def audit(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal writes
        if event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR):
            writes += 1

    sys.addaudithook(audit)
    logging.getLogger().setLevel(logging.INFO)
    most = {fault.__name__: lines_an_hour(fault, hours) for fault in FAULTS}
    print(json.dumps({"lines": most, "writes": writes}))


if __name__ == "__main__":
    main(int(sys.argv[1]))
