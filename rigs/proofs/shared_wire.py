"""A gateway with two masters: it asks for both in turn, and both get every reply."""

import random
from collections import deque
from collections.abc import Sequence

from bridge.simulator.conversation import Effect
from proofs.noisy_wire import Wire

_GIVES_UP_S = 0.15  # on a module that does not answer
_GAP_S = 0.002  # between a reply and the next request


class SharedWire:
    """Stands in front of a conversation, as a gateway does that lets two programs in.

    Attributes:
        served: How many frames of the other master were sent.
    """

    def __init__(
        self, wire: Wire, frames: Sequence[bytes], chance: random.Random, comes_at: float
    ) -> None:
        self.served = 0
        self._wire = wire
        self._frames = frames
        self._chance = chance
        self._waiting: deque[bytes] = deque()
        self._free_at = 0.0
        self._other_at = comes_at

    def hear(self, data: bytes, now: float) -> None:
        """See `Conversation`."""
        self._waiting.append(data)
        self._send(now)

    def next_at(self) -> float | None:
        """See `Conversation`."""
        said_at = self._wire.next_at()
        times = [self._other_at, *([] if said_at is None else [said_at])]
        return min([*times, *([self._free_at] if self._waiting else [])])

    def advance(self, now: float) -> list[Effect]:
        """See `Conversation`."""
        effects = self._wire.advance(now)
        if effects:
            self._free_at = now + _GAP_S
        if now >= self._other_at:
            # Whoever polls asks again as soon as it was answered, or has given up.
            self._other_at = now + self._chance.uniform(0.02, 0.12)
            self._waiting.append(self._chance.choice(self._frames))
            self.served += 1
        self._send(now)
        return effects

    def reset(self) -> None:
        """See `Conversation`."""
        self._waiting.clear()
        self._wire.reset()

    def _send(self, now: float) -> None:
        if self._waiting and now >= self._free_at:
            self._wire.hear(self._waiting.popleft(), now)
            self._free_at = now + _GIVES_UP_S
