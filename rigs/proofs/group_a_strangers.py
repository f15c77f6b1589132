"""A relay switched by another master on the line: A14, in virtual time."""

import logging
import random
from collections.abc import Iterator
from contextlib import contextmanager

from support.bus_worker import START_S, BusWorker, Script
from support.virtual_worker import make_line, make_station

from bridge.drivers import driver_for
from bridge.model import DIO100, DO100, LineProtocol
from proofs.figures import Figure, Run, proof

ALARM_WITHIN_S = 5.0
QUIET_S = 10.0  # before the stranger comes: no alarm is due
WATCHED_S = 6.0


class _Alarms(logging.Handler):
    """Notes when a worker warned of bytes that were not requested."""

    def __init__(self, worker: BusWorker) -> None:
        super().__init__(logging.WARNING)
        self.at: list[float] = []
        self._worker = worker

    def emit(self, record: logging.LogRecord) -> None:
        """Takes one record."""
        if "not requested" in record.getMessage():
            self.at.append(self._worker.line.now)


@contextmanager
def _alarms(worker: BusWorker) -> Iterator[list[float]]:
    handler = _Alarms(worker)
    logger = logging.getLogger("bridge.line.report")
    logger.addHandler(handler)
    try:
        yield handler.at
    finally:
        logger.removeHandler(handler)


def _foreign_frames(protocol: LineProtocol, chance: random.Random) -> list[bytes]:
    """Return the bytes of one exchange of the other master: request and reply."""
    driver = driver_for(protocol, chance.randint(3, 31), DIO100)
    requests = [driver.read_inputs.frame, driver.write_outputs(1, 1, 0).frame]
    replies = {
        LineProtocol.WISCO: b"DI>0000\r",
        LineProtocol.MODBUS_ASCII: b":0302020000F9\r\n",
        LineProtocol.MODBUS_RTU: bytes.fromhex("03 02 02 00 00 C0 78"),
    }
    request = chance.choice(requests)
    return [request, replies[protocol]] if chance.random() < 0.5 else [request]


def _stranger(worker: BusWorker, chance: random.Random, *, alone: bool) -> Script:
    """Comes after a while, and asks once or twice a second."""
    line = worker.bus_line
    for module in line.modules.values():
        module.away = alone
    yield QUIET_S
    until = line.now + WATCHED_S
    while line.now < until:
        for frame in _foreign_frames(worker.config.protocol, chance):
            line.conversation.inject(frame, line.now)
            yield 0.03
        yield chance.uniform(0.3, 0.9)


@proof("A14")
def foreign_frames(run: Run) -> Figure:
    """Another master on the line is noticed, whether our modules answer or not."""
    chance = random.Random(14)  # noqa: S311  # moments, not secrets
    visits = run.scale.of(4, 200)
    waited_s, early = [], 0
    for protocol in LineProtocol:
        stations = (make_station(1), make_station(2, DO100))
        for n in range(visits):
            worker = BusWorker(make_line(*stations, protocol=protocol))
            began = worker.line.now
            with _alarms(worker) as at:
                worker.follow(_stranger(worker, chance, alone=n % 4 == 3))
            came = began + START_S + QUIET_S
            early += sum(instant < came for instant in at)
            waited_s += [instant - came for instant in at if instant >= came][:1]
    total = visits * len(LineProtocol)
    longest_s = max(waited_s, default=0.0)
    return Figure(
        injected=f"{total} times another master on the line",
        seen=f"{len(waited_s)} alarms, the last after {longest_s:.1f} s; {early} before he came",
        promised=f"alarm within {ALARM_WITHIN_S:.0f} s, none without",
        kept=len(waited_s) == total and longest_s <= ALARM_WITHIN_S and not early,
    )
