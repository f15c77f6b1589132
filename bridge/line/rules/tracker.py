"""Decides which value of a group of channels may be published.

Two rules, in this order. A change in unprotected frames is read twice in a row (docs/contract.md,
promise 5); while replies to another master are heard, several times, some time apart. An input with
a debounce time has to keep its new value that long. Time is an argument (`bridge.clock.boot_s`).
"""

import math
from collections.abc import Mapping
from enum import Enum

from bridge.model import bit, channels_of

# Another master gets replies as often as it asks, so equal ones follow each other.
_APART_READS = 4


class Outcome(Enum):
    """The result of one read."""

    UNCHANGED = "unchanged"
    READ_AGAIN = "read again"
    READ_LATER = "read again in its turn"
    CHANGED = "changed"


class BankTracker:
    """All inputs, or all outputs, of one module: bit n-1 is channel n.

    Attributes:
        value: The value to publish; None before the first good read.
        confirmed_at: When the read was asked for that last confirmed the value.
    """

    __slots__ = (
        "_agreed",
        "_agreed_at",
        "_candidate",
        "_confirm",
        "_debounce_s",
        "_invert",
        "_since",
        "confirmed_at",
        "value",
    )

    def __init__(
        self, *, confirm: bool, invert: int = 0, debounce_s: Mapping[int, float] | None = None
    ) -> None:
        self.value: int | None = None
        self.confirmed_at = -math.inf
        self._confirm = confirm
        self._invert = invert
        self._debounce_s = dict(debounce_s or {})
        self._candidate: int | None = None
        self._agreed_at = 0.0
        self._agreed = 0
        self._since: dict[int, float] = {}

    @property
    def is_waiting(self) -> bool:
        """Return whether a new value waits for its second read."""
        return self._candidate is not None and self._candidate != self.value

    def forget(self) -> None:
        """Forget the value: the module is gone, and the next one is a first value."""
        self.value = None
        self.drop_candidate()
        self._since.clear()

    def drop_candidate(self) -> None:
        """Drop a value that waits for its second read: the module was written meanwhile."""
        self._candidate = None

    def observe(
        self,
        raw: int,
        now: float,
        *,
        asked_at: float | None = None,
        protected: bool = False,
        apart_s: float = 0.0,
    ) -> Outcome:
        """Use the value of one valid reply.

        Args:
            raw: The channels.
            now: The instant.
            asked_at: When the reply was asked for, which may be before a suspend; None: now.
            protected: The reply carries station and checksum.
            apart_s: The least time between equal reads, if it is not protected; 0: two in a row.
        """
        bits = raw ^ self._invert
        asked_at = now if asked_at is None else asked_at
        if bits == self.value:
            self.confirmed_at = asked_at
            self._candidate = None
            if self._since:
                self._since.clear()
            return Outcome.UNCHANGED
        if self._confirm and not protected:
            if bits != self._candidate:
                self._candidate, self._agreed_at, self._agreed = bits, now, 0
                return Outcome.READ_AGAIN
            if apart_s and not self._agrees(now, apart_s):
                return Outcome.READ_LATER
        # Kept as candidate: during a debounce time equal reads stay confirmed.
        self.confirmed_at = asked_at
        return self._take(bits, now)

    def _agrees(self, now: float, apart_s: float) -> bool:
        """Return whether enough equal reads came in a row, far enough apart."""
        if now - self._agreed_at >= apart_s:
            self._agreed_at = now
            self._agreed += 1
        return self._agreed >= _APART_READS

    def _take(self, bits: int, now: float) -> Outcome:
        if self.value is None or not self._debounce_s:
            settled = bits
        else:
            settled = self._settled(bits, self.value, now)
        if settled == self.value:
            return Outcome.UNCHANGED
        self.value = settled
        return Outcome.CHANGED

    def _settled(self, bits: int, old: int, now: float) -> int:
        """Return the value without changes whose debounce time has not passed."""
        changed = bits ^ old
        for channel in [c for c in self._since if not changed >> (c - 1) & 1]:
            del self._since[channel]
        held_back = 0
        for channel in channels_of(changed):
            since = self._since.setdefault(channel, now)
            if now - since < self._debounce_s.get(channel, 0.0):
                held_back |= bit(channel)
            else:
                del self._since[channel]
        return bits ^ held_back
