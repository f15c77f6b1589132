"""A gateway that says to whoever connects what it could not say before."""

import random
from collections import deque

from bridge.simulator.conversation import Conversation, Effect, Send

_REMEMBERED = 400
_WITHIN_S = 0.25  # of the connection


class ReplayingWire:
    """Stands in front of a conversation; each `reset` is a new connection.

    Attributes:
        replays: How many connections began with old replies.
    """

    def __init__(self, wire: Conversation, chance: random.Random) -> None:
        self.replays = 0
        self._wire = wire
        self._chance = chance
        self._said: deque[bytes] = deque(maxlen=_REMEMBERED)
        self._is_new = False

    def hear(self, data: bytes, now: float) -> None:
        """See `Conversation`."""
        self._wire.hear(data, now)

    def next_at(self) -> float | None:
        """See `Conversation`."""
        return self._wire.next_at()

    def advance(self, now: float) -> list[Effect]:
        """See `Conversation`."""
        if self._is_new:
            self._is_new = False
            self._replay(now)
        effects = self._wire.advance(now)
        self._said.extend(effect.data for effect in effects if isinstance(effect, Send))
        return effects

    def reset(self) -> None:
        """See `Conversation`."""
        self._wire.reset()
        self._is_new = True

    def _replay(self, now: float) -> None:
        if not self._said:
            return
        self.replays += 1
        for _ in range(self._chance.randint(1, 8)):
            self._wire.inject(
                self._chance.choice(self._said), now + self._chance.uniform(0, _WITHIN_S)
            )
