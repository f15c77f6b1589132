"""The interface of a bus for the line: the real bus, a measuring one, or one in virtual time."""

import math
from typing import Protocol, TypeVar

from bridge.model import Learned
from bridge.protocol.request import Request
from bridge.transport.bus import BusCounters
from bridge.transport.tap import Hear

T = TypeVar("T")


class Exchanger(Protocol):
    """One request out; its value back, or an error."""

    @property
    def quiet_until(self) -> float:
        """Return until when a late reply may come that does not carry its station."""

    @property
    def sent_at(self) -> float:
        """Return when the last request was sent."""

    @property
    def reply(self) -> bytes:
        """Return the bytes of the last reply."""

    @property
    def counters(self) -> BusCounters:
        """Return the results of the exchanges, and the count of unsolicited bytes."""

    @property
    def stray(self) -> bytes:
        """Return the last unsolicited bytes."""

    def free_at(self, address: int, *, protected: bool = False) -> float:
        """Return until when such a request is not sent to this station, because of late replies."""

    def listen(self, wait_s: float = 0.0) -> bytes:
        """Take unsolicited bytes off the line; `exchange` does it before each request."""

    def forget(self, address: int) -> None:
        """Forget the times that were learned of a station."""

    def learned(self, address: int) -> Learned:
        """Return the times of a station that are learned."""

    def tap(self, hear: Hear | None) -> None:
        """Call `hear` for each chunk that passes; see `bridge.transport.bus.Bus.tap`."""

    def exchange(self, request: Request[T], *, protected: bool, not_after: float = math.inf) -> T:
        """Make one exchange; see `bridge.transport.bus.Bus.exchange`."""

    def close(self) -> None:
        """Close the port."""
