"""A gateway that sends to a new client the bytes that it held back."""

import random
from collections import deque
from collections.abc import Callable

from bridge.simulator.conversation import Conversation, Effect, Send

_REMEMBERED = 4000
_OLD_S = 12.0  # so old is what was held back, at the least: it is not true any more
_WITHIN_S = 0.25  # of the connection


class ReplayingWire:
    """Stands in front of a conversation; each `reset` is a new connection.

    Attributes:
        replays: How many connections began with old replies.
    """

    def __init__(
        self, wire: Conversation, chance: random.Random, clock: Callable[[], float]
    ) -> None:
        self.replays = 0
        self._wire = wire
        self._chance = chance
        self._said: deque[tuple[float, bytes]] = deque(maxlen=_REMEMBERED)
        self._clock = clock

    def hear(self, data: bytes, now: float) -> None:
        """See `Conversation`."""
        self._wire.hear(data, now)

    def next_at(self) -> float | None:
        """See `Conversation`."""
        return self._wire.next_at()

    def advance(self, now: float) -> list[Effect]:
        """See `Conversation`."""
        effects = self._wire.advance(now)
        self._said.extend((now, effect.data) for effect in effects if isinstance(effect, Send))
        return effects

    def reset(self) -> None:
        """See `Conversation`."""
        self._wire.reset()
        self._replay(self._clock())

    def _replay(self, now: float) -> None:
        held = [data for at, data in self._said if at < now - _OLD_S]
        if not held:
            return
        self.replays += 1
        for _ in range(self._chance.randint(1, 8)):
            self._wire.inject(self._chance.choice(held), now + self._chance.uniform(0, _WITHIN_S))
