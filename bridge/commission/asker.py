"""Makes exchanges on a line, and keeps unsolicited bytes as evidence of clashes and noise."""

import time
from collections.abc import Callable
from typing import Protocol, TypeVar

from bridge.clock import boot_s
from bridge.errors import BadReplyError, ExchangeError, NoReplyError
from bridge.line.actions.contact import Asked
from bridge.protocol.request import Request
from bridge.transport.bus import Bus
from bridge.transport.port import Port
from bridge.transport.timing import LineTiming

T = TypeVar("T")

TRIES = 3  # of what is asked with patience
_MOST_KEPT = 256
_LISTEN_S = 0.3


def patiently(bus: Asked, request: Request[T], *, protected: bool) -> T:
    """Return the value of a request that does no harm when it is repeated.

    It is repeated when the answer is missing or damaged.
    """
    for _ in range(TRIES - 1):
        try:
            return bus.exchange(request, protected=protected)
        except (NoReplyError, BadReplyError):
            continue
    return bus.exchange(request, protected=protected)


class ScannedLine(Protocol):
    """A line for an examination; the bridge may be using it at the same time."""

    def exchange(self, request: Request[T], *, protected: bool) -> T:
        """Make one exchange; see `bridge.transport.bus.Bus.exchange`."""

    def strays(self) -> bytes:
        """Return the bytes that came besides the answers, without a request."""

    def listen(self) -> bytes:
        """Send nothing for a while; return what came."""


class KeepingPort:
    """A Port that keeps the bytes that are discarded unread.

    Attributes:
        strays: The unsolicited bytes since they were last taken.
    """

    def __init__(self, port: Port) -> None:
        self.strays = b""
        self._port = port

    @property
    def name(self) -> str:
        """See `Port`."""
        return self._port.name

    def read(self, count: int, deadline: float) -> bytes:
        """See `Port`."""
        return self._port.read(count, deadline)

    def write(self, data: bytes, deadline: float) -> None:
        """See `Port`."""
        self._port.write(data, deadline)

    def discard(self) -> bytes:
        """See `Port`."""
        data = self._port.discard()
        self.strays = (self.strays + data)[-_MOST_KEPT:]
        return data

    def close(self) -> None:
        """See `Port`."""
        self._port.close()


class Asker:
    """One line at one baud rate in one protocol, for our use alone. A scan gives it only reads.

    Attributes:
        least_s: The time of bytes, silences and time-outs of all requests so far.
    """

    def __init__(
        self,
        port: Port,
        timing: LineTiming,
        *,
        echo: bool | None = None,
        clock: Callable[[], float] = boot_s,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.least_s = 0.0
        self._port = KeepingPort(port)
        self._timing = timing
        self._clock = clock
        # No late window: a module that was found is asked again, and a late reply shows then.
        self._bus = Bus(self._port, timing, 0.0, clock, sleep)
        self._bus.echo = echo

    @property
    def echo(self) -> bool | None:
        """Return whether the adapter echoes our own bytes; None: not known yet."""
        return self._bus.echo

    def exchange(self, request: Request[T], *, protected: bool) -> T:
        """Make one exchange; see `Bus.exchange`."""
        chars = len(request.frame), request.reply_chars
        try:
            value = self._bus.exchange(request, protected=protected)
        except NoReplyError:
            self.least_s += self._timing.timeout_s(*chars)
            raise
        except ExchangeError:
            self.least_s += chars[0] * self._timing.char_s  # the actual reply may have been shorter
            raise
        self.least_s += self._timing.floor_s(*chars) - self._timing.turnaround_s
        return value

    def strays(self) -> bytes:
        """Return the bytes that came before the last request was sent."""
        strays, self._port.strays = self._port.strays, b""
        return strays

    def listen(self) -> bytes:
        """Send nothing for a while; return what came."""
        return self._port.read(_MOST_KEPT, self._clock() + _LISTEN_S)
