"""Requests to a line that are not commands: errands between the polls, and traces.

An errand (a scan, the dump of an EEPROM) is written as one conversation. Before each of its
exchanges the line serves commands and polls, so these are hardly delayed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from bridge.errors import BridgeError, PortError
from bridge.line.measured_bus import MeasuredBus
from bridge.model import LinePassed
from bridge.protocol.request import Request

T = TypeVar("T")

SHARE = 0.25  # of the time of the line, while other work waits
# A second module with the same address answers a little later than the first.
_HEAR_OUT_S = 0.03
_LISTEN_S = 0.3


class ErrandEndedError(BridgeError):
    """The line has no time for the errand any more."""


class SharedLine:
    """The line as an errand sees it. Only the thread of the line uses it.

    `turn` serves commands and polls once; it returns whether nothing more was due, and raises
    ErrandEndedError if the line is to end.
    """

    def __init__(
        self, bus: MeasuredBus, turn: Callable[[], bool], clock: Callable[[], float]
    ) -> None:
        self._bus = bus
        self._turn = turn
        self._clock = clock
        self._spent_s = 0.0  # time of the errand since commands and polls were last served
        self._ended = clock()

    @property
    def sent_at(self) -> float:
        """Return when the last request was sent."""
        return self._bus.sent_at

    def now(self) -> float:
        """Return the instant of the same clock."""
        return self._clock()

    def quieter(self, _silence_s: float) -> None:
        """Return None: others are asked on this line too, with its own silence."""

    def exchange(self, request: Request[T], *, protected: bool) -> T:
        """Make one exchange when it is our turn; see `bridge.transport.bus.Bus.exchange`.

        Raises:
            ErrandEndedError: The line is to end.
            PortError: The port is gone.
            ExchangeError: As `Bus.exchange`.
        """
        self._give_way()
        # A late reply of this station has to pass first; other work need not wait for that.
        free_at = self._bus.free_at(request.address, protected=protected)
        while self._clock() < free_at and not self._turn():
            free_at = self._bus.free_at(request.address, protected=protected)
        begun = self._clock()
        try:
            return self._bus.exchange_apart(request, protected=protected)
        finally:
            self._count(begun)

    def strays(self) -> bytes:
        """Return the bytes that came after the last reply, without a request."""
        return self._hear(_HEAR_OUT_S)

    def listen(self) -> bytes:
        """Send nothing for a while; return what came."""
        self._give_way()
        return self._hear(_LISTEN_S)

    def _hear(self, wait_s: float) -> bytes:
        begun = self._clock()
        try:
            return self._bus.listen_apart(wait_s)
        finally:
            self._count(begun)

    def _give_way(self) -> None:
        free_at = self._ended + self._spent_s * (1 / SHARE - 1)
        self._spent_s = 0.0
        while not self._turn() and self._clock() < free_at:
            pass

    def _count(self, begun: float) -> None:
        # A wait for a late reply also keeps the line from other work.
        ended = max(self._clock(), self._bus.quiet_until)
        self._spent_s += ended - max(begun, self._ended)
        self._ended = ended


Tell = Callable[[Mapping[str, Any]], None]


@dataclass(frozen=True, slots=True)
class ErrandTold:
    """A report of an errand.

    Attributes:
        data: Its progress, or at the end its result, in the form of an answer.
        ended: It is the last report.
        error: Why it ended without a result; None: it has one.
    """

    line: str
    id: int
    data: Mapping[str, Any]
    ended: bool = False
    error: str | None = None


@dataclass(frozen=True, slots=True)
class Errand:
    """Work for a line. `tell` is called in the line's thread; it may only enqueue.

    Attributes:
        id: By which who sent it knows it again.
        work: Does it, and gives what came of it. Raises BridgeError. What it is handed besides
            the line tells how far it is.
        tell: Takes what it has to say: any number of times, and once that it ended.
    """

    line: str
    id: int
    work: Callable[[SharedLine, Tell], Mapping[str, Any]]
    tell: Callable[[ErrandTold], None]

    def run(self, line: SharedLine) -> None:
        """Do the work. A PortError is reported, then raised."""
        try:
            result = self.work(line, lambda data: self.tell(ErrandTold(self.line, self.id, data)))
        except PortError as error:
            self.refuse(str(error))
            raise
        except BridgeError as error:
            self.refuse(str(error))
        else:
            self.tell(ErrandTold(self.line, self.id, result, ended=True))

    def refuse(self, error: str) -> None:
        """Report that it is not done, or not completed."""
        self.tell(ErrandTold(self.line, self.id, {}, ended=True, error=error))


@dataclass(frozen=True, slots=True)
class Trace:
    """Calls `tell` for everything that passes on the line from now on; None stops it.

    `tell` is called in the thread of the line and may only enqueue.
    """

    tell: Callable[[LinePassed], None] | None


@dataclass(frozen=True, slots=True)
class EndErrand:
    """The errand with this id is not wanted any more: it ends before its next exchange."""

    id: int


LineTask = Errand | EndErrand | Trace
