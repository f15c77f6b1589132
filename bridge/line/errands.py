"""Serves requests to a line that are not commands: errands between polls, and traces."""

from collections.abc import Callable

from bridge.line.errand import ErrandEndedError, SharedLine, Trace
from bridge.line.inbox import WaitingCommands
from bridge.line.measured_bus import MeasuredBus
from bridge.model import LinePassed
from bridge.transport.tap import Hear


class Errands:
    """The errands and the trace of one line worker. Only its thread uses it.

    `serve` serves commands and polls once; it returns whether nothing more was due, and raises
    ErrandEndedError if the line is to end.
    """

    def __init__(
        self,
        line: str,
        waiting: WaitingCommands,
        serve: Callable[[MeasuredBus], bool],
        clock: Callable[[], float],
    ) -> None:
        self._line = line
        self._waiting = waiting
        self._serve = serve
        self._clock = clock
        self._hear: Hear | None = None  # None: no trace is running

    def opened(self, bus: MeasuredBus) -> None:
        """Continue a trace: the port was opened."""
        bus.tap(self._hear)

    def work(self, bus: MeasuredBus) -> None:
        """Begin or end a trace, then do one errand to its end. Raises PortError."""
        self._take_trace(bus)
        if self._waiting.errands:
            errand = self._waiting.errands.popleft()
            errand.run(SharedLine(bus, lambda: self._give_way(bus, errand.id), self._clock))

    def refuse(self, why: str) -> None:
        """Refuse errands, because the port is gone. A trace waits for it."""
        while self._waiting.errands:
            self._waiting.errands.popleft().refuse(f"line {self._line} {why}")

    def _give_way(self, bus: MeasuredBus, errand_id: int) -> bool:
        idle = self._serve(bus)
        if self._waiting.unwanted_errand == errand_id:
            raise ErrandEndedError("it was stopped by a request")
        self._take_trace(bus)
        return idle

    def _take_trace(self, bus: MeasuredBus) -> None:
        trace, self._waiting.trace = self._waiting.trace, None
        if trace is not None:
            self._hear = _hear_of(trace, self._line)
            bus.tap(self._hear)


def _hear_of(trace: Trace, line: str) -> Hear | None:
    tell = trace.tell
    return tell and (lambda at, data, sent: tell(LinePassed(line, at, data, sent)))
