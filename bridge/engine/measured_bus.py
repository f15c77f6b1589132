"""Measures each exchange on its way to the bus: how it ended, and how long that took."""

from collections.abc import Callable
from typing import TypeVar

from bridge.engine.station import Exchanger
from bridge.engine.statistics import LineStatistics
from bridge.errors import ExchangeError
from bridge.protocol.request import Request

T = TypeVar("T")


class MeasuredBus:
    """An Exchanger around another. Lives as long as one open port, in the thread of its line."""

    def __init__(
        self, bus: Exchanger, statistics: LineStatistics, clock: Callable[[], float]
    ) -> None:
        self._bus = bus
        self._statistics = statistics
        self._stations = statistics.stations
        self._clock = clock

    @property
    def quiet_until(self) -> float:
        """See `Exchanger`."""
        return self._bus.quiet_until

    @property
    def sent_at(self) -> float:
        """See `Exchanger`."""
        return self._bus.sent_at

    def exchange(self, request: Request[T], *, protected: bool) -> T:
        """See `Exchanger`."""
        begun = self._clock()
        try:
            value = self._bus.exchange(request, protected=protected)
        except ExchangeError as error:
            now = self._clock()
            self._stations[request.station].failed(error, now)
            self._statistics.exchanged(now - begun)
            raise
        now = self._clock()
        self._stations[request.station].replied(now - self._bus.sent_at, now)
        self._statistics.exchanged(now - begun)
        return value

    def close(self) -> None:
        """See `Exchanger`."""
        self._bus.close()
