"""Verify as an errand of a line that polls and takes commands, on a virtual clock."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from support.bus_worker import BusWorker
from support.virtual_worker import make_line, make_station

from bridge.commission.verify.assumptions import FindingWord
from bridge.commission.verify.verification import Verification, modules_of
from bridge.line.errand import Errand, ErrandTold
from bridge.model import DIO100, DO100, AnyCommand, LineProtocol, Status, Verdict

BAUD = 19200
EVERY_S = 0.5


@dataclass(slots=True)
class Busy:
    """What came of the commands, and of verify."""

    asked: int = 0
    done: int = 0
    slowest_ms: int = 0
    other_writes: int = 0
    took_s: float = 0.0
    differs: list[str] = field(default_factory=list)


def beside_polls(protocol: LineProtocol, count: int, samples: int) -> Busy:
    """Verifies all modules of a line, with a command to one of them every half second."""
    models = (DIO100, DO100)
    stations = [make_station(at, models[at % 2]) for at in range(1, count + 1)]
    config = make_line(*stations, protocol=protocol, baud=BAUD)
    worker, busy, told = BusWorker(config), Busy(), list[ErrandTold]()
    work = Verification(config, modules_of(config, range(32)), samples)

    def script() -> Iterator[AnyCommand | float]:
        began, writes = worker.line.now, len(worker.writes())
        worker.worker.ask(Errand("main", 1, work.run, told.append))
        while not (told and told[-1].ended):
            values = 1 if busy.asked % 2 else 0
            verdict = yield worker.command(1, values, station_id=f"s{1 + busy.asked % count}")
            assert isinstance(verdict, Verdict)
            busy.asked += 1
            busy.done += verdict.status is Status.DONE
            busy.slowest_ms = max(busy.slowest_ms, verdict.ms)
            yield EVERY_S
        busy.took_s = worker.line.now - began
        busy.other_writes = len(worker.writes()) - writes - busy.asked

    worker.follow(script())  # type: ignore[arg-type]
    assert told[-1].error is None, told[-1].error
    busy.differs = [
        f"{station['name']} {finding['id']}: {finding['seen']}"
        for station in told[-1].data["stations"]
        for finding in station["findings"]
        if finding["word"] == FindingWord.DIFFERS
    ]
    return busy
