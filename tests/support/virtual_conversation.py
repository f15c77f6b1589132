"""Talks to simulated modules in virtual time: no thread, no port, no waiting."""

import random
from collections.abc import Iterable
from typing import NamedTuple

from bridge.model import LineProtocol
from bridge.simulator.conversation import Conversation, HangUp
from bridge.simulator.faults import Faults
from bridge.simulator.module import SimulatedModule
from bridge.simulator.wire import Pace

FREE = Pace(char_s=0.0, silence_s=0.0, turnaround_s=0.0)


class Piece(NamedTuple):
    """Bytes that reached the master, and when; None: the port went away."""

    at: float
    data: bytes | None


class VirtualClock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        """The time."""
        return self.now


class VirtualLine:
    """One line of which a test is the master."""

    def __init__(
        self,
        protocol: LineProtocol,
        modules: Iterable[SimulatedModule],
        pace: Pace = FREE,
        seed: int = 1,
    ) -> None:
        self.now = 0.0
        self.faults = Faults(random.Random(seed))  # noqa: S311 - damage, not secrets
        by_station = {module.address: module for module in modules}
        self.conversation = Conversation(protocol, by_station, pace, self.faults)

    def send(self, data: bytes) -> None:
        """Sends bytes now, and does not wait."""
        self.conversation.hear(data, self.now)

    def run(self, until: float = 1e9) -> list[Piece]:
        """Lets time go by, until nothing is left to happen or `until`."""
        pieces = []
        while (at := self.conversation.next_at()) is not None and at <= until:
            self.now = max(self.now, at)
            for effect in self.conversation.advance(self.now):
                data = None if isinstance(effect, HangUp) else effect.data
                pieces.append(Piece(self.now, data))
        return pieces

    def ask(self, frame: bytes) -> bytes:
        """Sends a frame and returns all that comes back, however late."""
        self.send(frame)
        return b"".join(piece.data or b"" for piece in self.run())
