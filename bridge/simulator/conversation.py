"""The conversation on one simulated line: requests in, replies out. Time is an argument.

This part does no input or output: `bridge.simulator.line` carries the bytes. Only the thread of the
line uses it.
"""

import heapq
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from bridge.model import LineProtocol
from bridge.simulator import modbus, wisco
from bridge.simulator.dialect import Tongue
from bridge.simulator.faults import FaultKind, Faults
from bridge.simulator.framing import LEAST_SILENCE_S, framer_for
from bridge.simulator.module import SimulatedModule
from bridge.simulator.recording import Recording
from bridge.simulator.wire import Pace

# On a paced line long replies come in pieces of this many characters, as from a real adapter.
PIECE_CHARS = 16
FLOOD_BYTES = 2000


@dataclass(frozen=True, slots=True)
class Send:
    """These bytes reach the master now."""

    data: bytes


@dataclass(frozen=True, slots=True)
class HangUp:
    """The port goes away now, for this time."""

    down_s: float


Effect = Send | HangUp


class Conversation:
    """The modules of one line, their faults, and the wire to the master."""

    def __init__(
        self,
        protocol: LineProtocol,
        modules: Mapping[int, SimulatedModule],
        pace: Pace,
        faults: Faults,
        recording: Recording | None = None,
        *,
        tongue: Tongue | None = None,
    ) -> None:
        self._recording = recording
        self._tongue = tongue or Tongue()
        self._replies = 0
        self._said_until = 0.0  # the last byte of a reply
        for module in modules.values():
            self._tongue.prepare(module)
        self._protocol = protocol
        self._modules = modules
        self._pace = pace
        self._faults = faults
        self._framer = framer_for(protocol)
        self._agenda: list[tuple[float, int, Callable[[float], None]]] = []
        self._order = itertools.count()  # keeps the order of events at one instant
        self._heard_until = 0.0
        self._held_back = b""
        self._effects: list[Effect] = []

    def hear(self, data: bytes, now: float) -> None:
        """Take bytes of the master; they are on the wire from `now` on."""
        silence_s = self._tongue.silence_s
        if silence_s and now - self._said_until < silence_s:
            return  # the module still listens to the end of what was before
        end = max(now, self._heard_until) + len(data) * self._pace.char_s
        self._heard_until = end
        if self._faults.draw(FaultKind.ECHO, data):
            self._at(end, partial(self._send, data))
        for frame in self._framer.feed(data):
            self._at(end, partial(self._obey, frame))
        if self._framer.waiting:
            self._at(
                end + max(self._pace.silence_s, LEAST_SILENCE_S), partial(self._fall_silent, end)
            )

    def inject(self, data: bytes, now: float) -> None:
        """Put unsolicited bytes on the wire, as of another master or a defective module."""
        self._say(data, now)

    def next_at(self) -> float | None:
        """Return when `advance` has something to do next."""
        return self._agenda[0][0] if self._agenda else None

    def advance(self, now: float) -> list[Effect]:
        """Do what is due by `now`."""
        while self._agenda and self._agenda[0][0] <= now:
            due, _, action = heapq.heappop(self._agenda)
            action(due)
        effects, self._effects = self._effects, []
        return effects

    def reset(self) -> None:
        """Forget requests and replies in progress: the port went away."""
        self._framer = framer_for(self._protocol)
        self._agenda.clear()
        self._effects.clear()
        self._held_back = b""

    def _at(self, due: float, action: Callable[[float], None]) -> None:
        heapq.heappush(self._agenda, (due, next(self._order), action))

    def _send(self, data: bytes, _due: float) -> None:
        self._effects.append(Send(data))

    def _fall_silent(self, heard_until: float, due: float) -> None:
        if heard_until == self._heard_until:
            for frame in self._framer.silence():
                self._obey(frame, due)

    # --- requests ---

    def _obey(self, frame: bytes, due: float) -> None:
        called = self._framer.address(frame)
        module = None if called is None else self._modules.get(called)
        if module is None or module.away:  # an absent module has no faults
            self._ask_all(frame, due)
            return
        draw = partial(self._faults.draw, frame=frame, address=module.address)
        if fault := draw(FaultKind.HANG_UP):
            self._effects.append(HangUp(fault.delay_s))
        elif draw(FaultKind.DEAF):
            return
        elif fault := draw(FaultKind.FLIP_REQUEST):
            self._ask_damaged(self._faults.flip(frame, fault.bit), due)
        elif draw(FaultKind.REFUSE):
            self._ask_all(frame, due, failing=True)
        else:
            self._ask_all(frame, due)

    def _ask_damaged(self, data: bytes, due: float) -> None:
        """Handle a request with a flipped bit, which may have changed the ends of its frame."""
        receiver = framer_for(self._protocol)
        for frame in receiver.feed(data) + receiver.silence():
            self._ask_all(frame, due)

    def _ask_all(self, frame: bytes, due: float, *, failing: bool = False) -> None:
        for module in self._modules.values():
            if not module.away and (reply := self._answer(module, frame, failing)):
                self._say_shaped(reply, frame, module.address, due)
        if self._recording and (reply := self._recording.answer(frame, due)):
            self._say_shaped(reply, frame, self._framer.address(frame), due)

    def _answer(self, module: SimulatedModule, frame: bytes, failing: bool) -> bytes | None:
        if self._protocol is LineProtocol.MODBUS_RTU:
            return modbus.answer_rtu(module, frame, failing=failing)
        if frame.startswith(b"#"):
            reply = wisco.answer(module, frame, failing=failing)
            return reply and self._tongue.wisco(module, frame, reply)
        if module.wisco_only:
            return None
        reply = modbus.answer_ascii(module, frame, failing=failing)
        return reply and self._tongue.ascii(reply)

    # --- replies ---

    def _say_shaped(self, reply: bytes, frame: bytes, address: int | None, due: float) -> None:
        draw = partial(self._faults.draw, frame=frame, address=address)
        if draw(FaultKind.SILENT):
            return
        if draw(FaultKind.FLOOD):
            reply = self._faults.noise(FLOOD_BYTES, FLOOD_BYTES)
        if fault := draw(FaultKind.FLIP):
            reply = self._faults.flip(reply, fault.bit)
        if draw(FaultKind.TRUNCATE):
            reply = self._faults.cut(reply)
        if draw(FaultKind.MERGE):
            self._held_back += reply
            return
        reply, self._held_back = self._held_back + reply, b""
        if draw(FaultKind.DUPLICATE):
            reply *= 2
        if draw(FaultKind.NOISE):
            reply = self._faults.noise(1, 4) + reply + self._faults.noise(1, 4)
        late = draw(FaultKind.LATE)
        start = due + self._pace.silence_s + self._pace.turnaround_s
        start += self._tongue.delay_s(self._replies)
        self._replies += 1
        self._say(reply, start + (late.delay_s if late else 0.0))

    def _say(self, data: bytes, start: float) -> None:
        """Put bytes on the wire; each piece reaches the master when its last bit has passed."""
        size = PIECE_CHARS if self._pace.char_s else len(data)
        at = start
        for offset in range(0, len(data), size):
            piece = data[offset : offset + size]
            at += len(piece) * self._pace.char_s
            self._at(at, partial(self._send, piece))
        self._said_until = max(self._said_until, at)
