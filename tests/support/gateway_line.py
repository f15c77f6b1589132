"""A virtual line behind a gateway on the network, with what gateways do of their own accord."""

import math
from dataclasses import replace
from typing import TypeVar

from support.virtual_line import Fault, VirtualLine
from support.virtual_worker import VirtualWorker

from bridge.config.schema import LineConfig
from bridge.errors import PortError
from bridge.line.exchanger import Exchanger
from bridge.model import LineChanged
from bridge.protocol.request import Request

T = TypeVar("T")

CLOSED = "tcp://gateway:4196: the gateway closed the connection"


class GatewayLine(VirtualLine):
    """Drops connections by their age, or when nothing came from its modules for a while.

    Attributes:
        drop_after_s: How old a connection gets.
        idle_s: How long it may bring nothing.
        deaf_before: Connections that were opened before this instant pass nothing on any more.
    """

    def __init__(self, config: LineConfig, *, wisco_only: bool = False) -> None:
        super().__init__(config, wisco_only=wisco_only)
        self.drop_after_s = math.inf
        self.idle_s = math.inf
        self.deaf_before = -math.inf
        self._heard_at = 0.0

    def open(self, config: LineConfig) -> Exchanger:
        """See `VirtualLine`."""
        super().open(config)
        self._heard_at = self.now
        return self

    def listen(self, wait_s: float = 0.0) -> bytes:
        """See `VirtualLine`; a connection that is closed shows here."""
        super().listen(wait_s)
        self._pass()
        return b""

    def exchange(self, request: Request[T], *, protected: bool, not_after: float = math.inf) -> T:
        """See `VirtualLine`."""
        self._pass()
        if self.opened[-1] < self.deaf_before <= self.now:
            fault, self.fault = self.fault, lambda _: Fault.LOSE_REQUEST
            try:
                return super().exchange(request, protected=protected, not_after=not_after)
            finally:
                self.fault = fault
        value = super().exchange(request, protected=protected, not_after=not_after)
        self._heard_at = self.now
        return value

    def _pass(self) -> None:
        too_old = self.now - self.opened[-1] >= self.drop_after_s
        if too_old or self.now - self._heard_at >= self.idle_s:
            raise PortError(CLOSED)


class GatewayWorker(VirtualWorker):
    """A line worker on a `GatewayLine`.

    Attributes:
        gateway: The line.
    """

    def __init__(self, config: LineConfig) -> None:
        config = replace(config, port="tcp://gateway:4196")
        self.gateway = GatewayLine(config)
        super().__init__(config, line=self.gateway)

    def told_of_line(self) -> list[tuple[float, bool]]:
        """Return the reported changes of the line."""
        return [(at, e.online) for at, e in self.events if isinstance(e, LineChanged)]
