"""Measures each exchange on its way to the bus: result, time, and unsolicited bytes."""

import logging
import math
from collections.abc import Callable
from typing import TypeVar

from bridge.errors import ExchangeError, NoReplyError, RefusedError
from bridge.line.exchanger import Exchanger
from bridge.line.rules.strays import StrayWatch
from bridge.line.statistics import LineStatistics
from bridge.model import Learned
from bridge.protocol.request import Request
from bridge.transport.tap import Hear

T = TypeVar("T")

_log = logging.getLogger(__name__)


class MeasuredBus:
    """An Exchanger around another. It lives as long as an open port, in the thread of its line.

    `may_wait` is called before each exchange, so it also serves as sign of life. If it returns
    False, an exchange with a module that does not answer fails at once.

    Attributes:
        silent: The stations that gave no valid answer to their last exchange.
    """

    def __init__(
        self,
        bus: Exchanger,
        statistics: LineStatistics,
        strays: StrayWatch,
        clock: Callable[[], float],
        may_wait: Callable[[], bool] = lambda: True,
    ) -> None:
        self.counters = bus.counters
        self.silent: set[int] = set()
        self._may_wait = may_wait
        self._bus = bus
        self._statistics = statistics
        statistics.learned = bus.learned
        self._strays = strays
        self._stations = statistics.stations
        self._clock = clock
        self._strays_before: int | None = None  # None: the first exchange is not over

    @property
    def quiet_until(self) -> float:
        """See `Exchanger`."""
        return self._bus.quiet_until

    @property
    def sent_at(self) -> float:
        """See `Exchanger`."""
        return self._bus.sent_at

    @property
    def stray(self) -> bytes:
        """See `Exchanger`."""
        return self._bus.stray

    @property
    def reply(self) -> bytes:
        """See `Exchanger`."""
        return self._bus.reply

    def free_at(self, address: int, *, protected: bool = False) -> float:
        """See `Exchanger`."""
        return self._bus.free_at(address, protected=protected)

    def exchange(self, request: Request[T], *, protected: bool, not_after: float = math.inf) -> T:
        """See `Exchanger`."""
        if not self._may_wait() and request.address in self.silent:
            raise NoReplyError(f"station {request.address} was not asked: the line ends")
        begun = self._clock()
        try:
            value = self._bus.exchange(request, protected=protected, not_after=not_after)
        except ExchangeError as error:
            now = self._clock()
            self._heard(request.address, answered=isinstance(error, RefusedError))
            if _log.isEnabledFor(logging.DEBUG):
                self._log_exchange(request, f"{error}", now)
            self._stations[request.address].failed(error, now)
            self._exchanged(begun, now)
            raise
        self._heard(request.address, answered=True)
        now = self._clock()
        if _log.isEnabledFor(logging.DEBUG):
            self._log_exchange(request, self._bus.reply.hex(" "), now)
        self._stations[request.address].replied(now - self._bus.sent_at, now)
        self._exchanged(begun, now)
        return value

    def listen(self, wait_s: float = 0.0) -> bytes:
        """See `Exchanger`."""
        heard = self._bus.listen(wait_s)
        if self.counters.unsolicited_bytes != self._strays_before:
            self._tell_strays(self._clock())
        return heard

    def forget(self, address: int) -> None:
        """See `Exchanger`."""
        self._bus.forget(address)

    def learned(self, address: int) -> Learned:
        """See `Exchanger`."""
        return self._bus.learned(address)

    def tap(self, hear: Hear | None) -> None:
        """See `Exchanger`."""
        self._bus.tap(hear)

    # --- for who draws his own conclusions ------------------------------------------------------

    def exchange_apart(self, request: Request[T], *, protected: bool) -> T:
        """Make an exchange that counts for no station and causes no warning.

        The caller gets the bytes that come besides the answer, but not those from before.
        """
        self._may_wait()
        self.listen()
        begun = self._clock()
        try:
            return self._bus.exchange(request, protected=protected)
        finally:
            self._apart(begun)

    def listen_apart(self, wait_s: float) -> bytes:
        """Send nothing for this time; return what came."""
        begun = self._clock()
        try:
            return self._bus.listen(wait_s)
        finally:
            self._apart(begun)

    def _apart(self, begun: float) -> None:
        self._statistics.busy_s += self._clock() - begun
        self._strays_before = self.counters.unsolicited_bytes

    def close(self) -> None:
        """See `Exchanger`."""
        self._bus.close()

    def _heard(self, address: int, *, answered: bool) -> None:
        if answered:
            self.silent.discard(address)
        else:
            self.silent.add(address)

    def _log_exchange(self, request: Request[T], outcome: str, now: float) -> None:
        _log.debug(
            "line %s station %d: %s -> %s (%.1f ms)",
            self._statistics.line,
            request.address,
            request.frame.hex(" "),
            outcome,
            (now - self._bus.sent_at) * 1000,
        )

    def _exchanged(self, begun: float, now: float) -> None:
        self._statistics.busy_s += now - begun
        if self.counters.unsolicited_bytes != self._strays_before:
            self._tell_strays(now)

    def _tell_strays(self, now: float) -> None:
        strays = self.counters.unsolicited_bytes
        new = strays - (self._strays_before or 0)
        self._statistics.unsolicited_bytes += new
        # Bytes found by the first exchange may have been there long before the port was opened.
        if self._strays_before is not None:
            self._strays.heard(new, self._bus.stray, now)
        self._strays_before = strays
