"""A wire on which bits flip at a given rate, both ways."""

import math
import random
from typing import Protocol

from bridge.simulator.conversation import Effect, Send

_BITS_PER_CHAR = 10  # docs/protocol.md section 1: 1 start, 8 data, 1 stop


class Wire(Protocol):
    """The part of `bridge.simulator.conversation.Conversation` that a master needs."""

    def hear(self, data: bytes, now: float) -> None:
        """See `Conversation`."""
        ...

    def next_at(self) -> float | None:
        """See `Conversation`."""
        ...

    def advance(self, now: float) -> list[Effect]:
        """See `Conversation`."""
        ...

    def reset(self) -> None:
        """See `Conversation`."""
        ...


class NoisyWire:
    """Stands in front of a conversation. A flipped start or stop bit loses its character.

    Attributes:
        flips: How many bits were flipped.
    """

    def __init__(self, wire: Wire, bit_error_rate: float, chance: random.Random) -> None:
        self.flips = 0
        self._wire = wire
        self._log_good = math.log1p(-bit_error_rate)
        self._chance = chance
        self._good_bits = self._gap()

    def hear(self, data: bytes, now: float) -> None:
        """See `Conversation`."""
        self._wire.hear(self._damaged(data), now)

    def next_at(self) -> float | None:
        """See `Conversation`."""
        return self._wire.next_at()

    def advance(self, now: float) -> list[Effect]:
        """See `Conversation`."""
        return [
            Send(self._damaged(each.data)) if isinstance(each, Send) else each
            for each in self._wire.advance(now)
        ]

    def reset(self) -> None:
        """See `Conversation`."""
        self._wire.reset()

    def _gap(self) -> int:
        """Return the number of bits before the next flip, which is drawn once for each flip."""
        return int(math.log(1 - self._chance.random()) / self._log_good)

    def _damaged(self, data: bytes) -> bytes:
        bits = _BITS_PER_CHAR * len(data)
        if self._good_bits >= bits:
            self._good_bits -= bits
            return data
        damaged: list[int | None] = list(data)
        at = self._good_bits
        while at < bits:
            self.flips += 1
            index, bit = divmod(at, _BITS_PER_CHAR)
            byte = damaged[index]
            damaged[index] = None if byte is None or bit in {0, 9} else byte ^ 1 << (bit - 1)
            at += 1 + self._gap()
        self._good_bits = at - bits
        return bytes(byte for byte in damaged if byte is not None)
