"""A line worker without its thread: run in the test's own, on the clock of a virtual line."""

import queue

from support.commands import make_command
from support.virtual_line import Fault, VirtualLine

from bridge.config.schema import InputConfig, LineConfig, OutputConfig, StationConfig
from bridge.line.inbox import Item
from bridge.line.worker import LineWorker
from bridge.model import (
    DIO100,
    LineEvent,
    LineMeasured,
    LineProtocol,
    ModuleType,
    StationChanged,
    StationMeasured,
    Verdict,
    Word,
    Writes,
)
from bridge.simulator.faults import is_write


def make_station(
    address: int = 1,
    model: ModuleType = DIO100,
    *,
    outputs: tuple[OutputConfig, ...] | None = None,
    inputs: tuple[InputConfig, ...] | None = None,
) -> StationConfig:
    """A module `s1`, `s2`, ... with all its channels."""
    if outputs is None:
        outputs = tuple(OutputConfig(n) for n in range(1, model.outputs + 1))
    if inputs is None:
        inputs = tuple(InputConfig(n) for n in range(1, model.inputs + 1))
    return StationConfig(address, model, f"s{address}", f"s{address}", inputs, outputs)


def make_line(
    *stations: StationConfig,
    protocol: LineProtocol = LineProtocol.WISCO,
    writes: Writes = Writes.AUTO,
    baud: int = 9600,
) -> LineConfig:
    """A line `main`; of one DIO100 if nothing else is said."""
    return LineConfig("main", "/dev/rs485", baud, protocol, stations or (make_station(),), writes)


class _VirtualInbox(queue.SimpleQueue[Item]):
    """Waits on the virtual clock."""

    def __init__(self, line: VirtualLine) -> None:
        super().__init__()
        self._line = line

    def get(self, block: bool = True, timeout: float | None = None) -> Item:
        """See `queue.SimpleQueue`."""
        until = self._line.now + (timeout or 0.0)
        while block and self.empty() and self._line.now < until:
            self._line.advance(min(until, self._line.next_action_at()))
        return super().get(block=False)


class VirtualWorker:
    """One line worker, its line, and everything that it reported.

    Attributes:
        events: What it reported, with the instant, but for its measures.
        measured: How it did, once in a while.
    """

    def __init__(
        self,
        config: LineConfig | None = None,
        *,
        wisco_only: bool = False,
        line: VirtualLine | None = None,
    ) -> None:
        self.config = config or make_line()
        self.line = line or VirtualLine(self.config, wisco_only=wisco_only)
        self.events: list[tuple[float, LineEvent]] = []
        self.measured: list[tuple[float, LineMeasured | StationMeasured]] = []
        self.worker = LineWorker(
            self.config,
            self.report,
            self.line.open,
            self.line.clock,
            self.line.sleep,
            inbox=_VirtualInbox(self.line),
        )

    def report(self, event: LineEvent) -> None:
        """Takes what the worker reports."""
        if isinstance(event, LineMeasured | StationMeasured):
            self.measured.append((self.line.now, event))
        else:
            self.events.append((self.line.now, event))

    def run(self, until: float) -> None:
        """Works from instant 100 to `until`, and ends."""
        self.line.at(until, self.worker.stop)
        self.worker.work()

    def command_at(
        self,
        instant: float,
        mask: int,
        values: int = 0,
        *,
        word: Word | None = None,
        station_id: str = "s1",
        deadline_s: float = 2.0,
        command_id: str | None = None,
    ) -> None:
        """Has a command arrive at `instant`."""
        command = make_command(
            mask,
            values,
            word=word,
            station_id=station_id,
            arrived=instant,
            deadline=instant + deadline_s,
            command_id=command_id,
        )
        self.line.at(instant, lambda: self.worker.submit(command))

    def reported(self, since: float = 0.0) -> list[LineEvent]:
        """The events from an instant on."""
        return [event for at, event in self.events if at >= since]

    def verdicts(self) -> list[Verdict]:
        """All verdicts, in their order."""
        return [event for _, event in self.events if isinstance(event, Verdict)]

    def verdict(self) -> Verdict:
        """The one verdict."""
        (verdict,) = self.verdicts()
        return verdict

    def writes(self) -> list[bytes]:
        """The frames on the wire that switch something."""
        return [frame for _, frame in self.line.wire if is_write(frame)]

    def online_at(self, station_id: str = "s1") -> list[tuple[float, bool]]:
        """When a station came and went."""
        return [
            (at, event.online)
            for at, event in self.events
            if isinstance(event, StationChanged) and event.station_id == station_id
        ]

    def fault_on_writes(self, *faults: Fault | None) -> None:
        """The first write frames fare so, one fault each; everything else is well."""
        left = list(faults)

        def fault(frame: bytes) -> Fault | None:
            return left.pop(0) if left and is_write(frame) else None

        self.line.fault = fault

    def fault_from_first_write(self, first: Fault | None, then: Fault) -> None:
        """The first write frame fares so, and from then on all exchanges that way."""
        begun = False

        def fault(frame: bytes) -> Fault | None:
            nonlocal begun
            if begun:
                return then
            if is_write(frame):
                begun = True
                return first
            return None

        self.line.fault = fault
