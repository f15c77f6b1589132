"""The line as verify has it: a port of its own, or between the polls of a bridge at work."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeVar

from bridge.clock import boot_s
from bridge.commission.asker import ScannedLine
from bridge.protocol.request import Request
from bridge.transport.bus import Bus
from bridge.transport.port import Port
from bridge.transport.timing import LineTiming

T = TypeVar("T")

_HEAR_OUT_S = 0.03
_LISTEN_S = 0.3


class VerifiedLine(ScannedLine, Protocol):
    """Describe what verify needs of a line."""

    @property
    def sent_at(self) -> float:
        """Return when the last request was sent."""

    def now(self) -> float:
        """Return the instant of the same clock."""

    def quieter(self, silence_s: float) -> "VerifiedLine | None":
        """Return the line with this silence before each request; None: that cannot be chosen."""


class WatchedLine:
    """A line that calls `step` before each exchange: so that who waits knows how far it is."""

    def __init__(self, line: VerifiedLine, step: Callable[[], None]) -> None:
        self._line = line
        self._step = step

    @property
    def sent_at(self) -> float:
        """See `VerifiedLine`."""
        return self._line.sent_at

    def now(self) -> float:
        """See `VerifiedLine`."""
        return self._line.now()

    def exchange(self, request: Request[T], *, protected: bool) -> T:
        """See `ScannedLine`."""
        self._step()
        return self._line.exchange(request, protected=protected)

    def strays(self) -> bytes:
        """See `ScannedLine`."""
        return self._line.strays()

    def listen(self) -> bytes:
        """See `ScannedLine`."""
        return self._line.listen()

    def quieter(self, silence_s: float) -> "WatchedLine | None":
        """See `VerifiedLine`."""
        line = self._line.quieter(silence_s)
        return None if line is None else WatchedLine(line, self._step)


class OwnLine:
    """An open port that is ours alone. Late replies are waited for, not let pass."""

    def __init__(
        self,
        port: Port,
        timing: LineTiming,
        clock: Callable[[], float] = boot_s,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._port = port
        self._timing = timing
        self._clock = clock
        self._sleep = sleep
        self._bus = Bus(port, timing, 0.0, clock, sleep)

    @property
    def sent_at(self) -> float:
        """See `VerifiedLine`."""
        return self._bus.sent_at

    def now(self) -> float:
        """See `VerifiedLine`."""
        return self._clock()

    def exchange(self, request: Request[T], *, protected: bool) -> T:
        """See `ScannedLine`."""
        return self._bus.exchange(request, protected=protected)

    def strays(self) -> bytes:
        """Return what came behind the last reply."""
        return self._bus.listen(_HEAR_OUT_S)

    def listen(self) -> bytes:
        """See `ScannedLine`."""
        return self._bus.listen(_LISTEN_S)

    def quieter(self, silence_s: float) -> "OwnLine":
        """See `VerifiedLine`."""
        other = OwnLine(
            self._port, replace(self._timing, silence_s=silence_s), self._clock, self._sleep
        )
        other._bus.echo = self._bus.echo
        return other
