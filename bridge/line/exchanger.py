"""What the line needs of a bus: the bus itself, one that measures, or one in virtual time."""

import math
from typing import Protocol, TypeVar

from bridge.protocol.request import Request
from bridge.transport.bus import BusCounters
from bridge.transport.tap import Hear

T = TypeVar("T")


class Exchanger(Protocol):
    """Describe what the engine needs of the bus: one request out, its value back, or an error."""

    @property
    def quiet_until(self) -> float:
        """No request goes out before this instant: a late reply may be on its way."""
        ...

    @property
    def sent_at(self) -> float:
        """Return when the last request went out."""
        ...

    @property
    def reply(self) -> bytes:
        """Return what the last request brought back."""
        ...

    @property
    def counters(self) -> BusCounters:
        """Return how the exchanges went, and what came besides."""
        ...

    @property
    def stray(self) -> bytes:
        """Return what was heard when bytes last came that were not requested."""
        ...

    def free_at(self, station: int) -> float:
        """No request goes out to this station before this instant: its late reply has to pass."""
        ...

    def listen(self, wait_s: float = 0.0) -> bytes:
        """Take off the line what was not requested; `exchange` does it before each request."""
        ...

    def tap(self, hear: Hear | None) -> None:
        """Have every piece that passes told; see `bridge.transport.bus.Bus.tap`."""
        ...

    def exchange(self, request: Request[T], *, protected: bool, not_after: float = math.inf) -> T:
        """Make one exchange; see `bridge.transport.bus.Bus.exchange`."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...
