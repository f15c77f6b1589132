"""A line of simulated modules on a virtual clock, in place of port and bus.

What a module says is the simulator's own opinion; what it costs is what the bus would take.
"""

import math
from collections.abc import Callable, Iterable
from enum import Enum
from typing import TypeVar, cast

from bridge.config.schema import LineConfig
from bridge.errors import BadReplyError, ExpiredError, NoReplyError, PortError
from bridge.line.exchanger import Exchanger
from bridge.model import NOTHING_LEARNED, Learned
from bridge.protocol.request import Request
from bridge.simulator import modbus, wisco
from bridge.simulator.module import SimulatedModule
from bridge.transport.bus import BusCounters
from bridge.transport.tap import Hear

T = TypeVar("T")

_TURNAROUND_S = 0.005
_MARGIN_S = 0.1
_LATE_WINDOW_S = 0.3


class Fault(Enum):
    """The fault of one exchange."""

    LOSE_REQUEST = "the module hears nothing"
    LOSE_REPLY = "the module obeys, and its reply is lost"
    GARBLE_REPLY = "the module obeys, and its reply is damaged"
    FLIP_REPLY = "the module obeys, and one bit of a value in its reply is flipped"
    REFUSE = "the module says no"
    IGNORE = "the module says yes, and does nothing"
    PORT_GONE = "the port is gone before a byte was sent"
    PORT_GONE_AFTER = "the module obeys, and then the port is gone"


class VirtualLine:
    """Modules, a clock, and a log of every frame.

    Attributes:
        now: The clock, in seconds.
        modules: By station.
        wire: Every frame that was sent, with the instant.
        fault: Decides by its frame what happens to an exchange; None: nothing.
        open_error: Why the port cannot be opened; None: it can.
        opened: Instants at which somebody tried to open it.
        closed: How often it was closed.
    """

    def __init__(self, config: LineConfig, *, wisco_only: bool = False) -> None:
        self.now = 100.0
        self.baud = config.baud
        self.modules = {
            station_config.address: SimulatedModule(
                station_config.model,
                station_config.address,
                wisco_only=wisco_only,
                clock=self.clock,
            )
            for station_config in config.stations
        }
        self.wire: list[tuple[float, bytes]] = []
        self.fault: Callable[[bytes], Fault | None] = lambda _: None
        self.open_error: str | None = None
        self.opened: list[float] = []
        self.closed = 0
        self.quiet_until = 0.0
        self.sent_at = 0.0
        self.reply = b""
        self.counters = BusCounters()
        self.stray = b""
        self._late_from: dict[int, float] = {}
        self._actions: list[tuple[float, int, Callable[[], None]]] = []

    # --- the clock ----------------------------------------------------------------------------

    def clock(self) -> float:
        """The instant."""
        return self.now

    def at(self, instant: float, action: Callable[[], None]) -> None:
        """Has something done when the clock comes to `instant`."""
        self._actions.append((instant, len(self._actions), action))
        self._actions.sort(key=lambda item: item[:2])

    def next_action_at(self) -> float:
        """Return when the next action is due."""
        return self._actions[0][0] if self._actions else float("inf")

    def advance(self, until: float) -> None:
        """Lets time pass, and does what is due on the way."""
        while self.next_action_at() <= until:
            instant, _, action = self._actions.pop(0)
            self.now = max(self.now, instant)
            action()
        self.now = max(self.now, until)

    def sleep(self, seconds: float) -> None:
        """Stands in for `time.sleep`."""
        self.advance(self.now + seconds)

    # --- what a bus does ----------------------------------------------------------------------

    def open(self, config: LineConfig) -> Exchanger:
        """Opens the port, or raises PortError."""
        self.opened.append(self.now)
        if self.open_error is not None:
            raise PortError(f"{config.port}: {self.open_error}")
        return self

    def close(self) -> None:
        """See `Bus`."""
        self.closed += 1

    def listen(self, wait_s: float = 0.0) -> bytes:
        """Return no bytes, as nothing sends unasked here; see `Bus`."""
        self.advance(self.now + wait_s)
        return b""

    def forget(self, _station: int) -> None:
        """See `Bus`: nothing is learned here."""

    def learned(self, _station: int) -> Learned:
        """See `Bus`."""
        return NOTHING_LEARNED

    def tap(self, hear: Hear | None) -> None:
        """See `Bus`: nothing passes as bytes here."""

    def free_at(self, address: int, *, protected: bool = False) -> float:
        """See `Bus`: no reply is ever late here, but the time for it is kept."""
        own = self._late_from.get(address, 0.0)
        return own if protected else max(self.quiet_until, own)

    def exchange(self, request: Request[T], *, protected: bool, not_after: float = math.inf) -> T:
        """See `Bus.exchange`."""
        self.advance(self.free_at(request.address, protected=protected))
        if self.now > not_after:
            raise ExpiredError("too late")
        frame = request.frame
        fault = self.fault(frame)
        if fault is Fault.PORT_GONE:
            raise PortError("the port is gone")
        self.sent_at = self.now
        self.wire.append((self.now, frame))
        char_s = 10 / self.baud
        self.advance(self.now + len(frame) * char_s)
        reply = self.reply = self._reply(frame, fault)
        if fault is Fault.PORT_GONE_AFTER:
            raise PortError("the port is gone")
        self.advance(self.now + _TURNAROUND_S + len(reply) * char_s)
        if request.missing(reply):
            self.advance(self.now + _MARGIN_S + (request.reply_chars - len(reply)) * char_s)
            if not protected:
                self.quiet_until = self.now + _LATE_WINDOW_S
                self._late_from[request.address] = self.quiet_until
            if reply:
                raise BadReplyError("an incomplete reply", reply)
            raise NoReplyError(f"station {request.address} did not answer")
        return cast("T", request.decode(reply))

    def _reply(self, frame: bytes, fault: Fault | None) -> bytes:
        if fault is Fault.LOSE_REQUEST:
            return b""
        modules: Iterable[SimulatedModule] = self.modules.values()
        if fault is Fault.IGNORE:
            modules = [_twin(module) for module in modules]
        reply = self._answer(frame, modules, failing=fault is Fault.REFUSE)
        if fault is Fault.GARBLE_REPLY:
            return _flipped(reply, 1)
        if fault is Fault.FLIP_REPLY:
            return _flipped(reply, len(reply) - 2)
        return b"" if fault is Fault.LOSE_REPLY else reply

    def _answer(self, frame: bytes, modules: Iterable[SimulatedModule], *, failing: bool) -> bytes:
        address = frame[0] if frame[0] < 32 else int(frame[1:3], 16)
        for module in modules:
            if address in {0, module.address} and not module.away:  # 0 may be a broadcast
                reply = reply_of(module, frame, failing=failing)
                if reply is not None:
                    return reply
        return b""


def reply_of(module: SimulatedModule, frame: bytes, *, failing: bool) -> bytes | None:
    """Return the answer of a module to a frame of any protocol, or None."""
    if frame.startswith(b"#"):
        return wisco.answer(module, frame, failing=failing)
    if frame.startswith(b":"):
        return None if module.wisco_only else modbus.answer_ascii(module, frame, failing=failing)
    return modbus.answer_rtu(module, frame, failing=failing)


def _twin(module: SimulatedModule) -> SimulatedModule:
    """Another module of the same kind, that can be switched instead."""
    return SimulatedModule(module.model, module.address, wisco_only=module.wisco_only)


def _flipped(reply: bytes, at: int) -> bytes:
    """The reply with one bit of one character flipped: at 1, no form lets it pass."""
    return reply[:at] + bytes(byte ^ 0x02 for byte in reply[at : at + 1]) + reply[at + 1 :]
