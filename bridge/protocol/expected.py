"""How the two replies to a request begin, the yes and the no, and so how much is still due."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Expected:
    """The fixed beginnings of the reply that says yes and of the one that says no.

    Attributes:
        yes: How the reply begins that says yes, as far as that is known beforehand.
        yes_chars: Its whole length.
        no: How a refusal begins.
        no_chars: Its whole length: a refusal is the shorter, or equal.
    """

    yes: bytes
    yes_chars: int
    no: bytes
    no_chars: int

    def left(self, begun: bytes) -> int:
        """Return what is due of the shortest reply that starts with `begun`.

        0 or less: no reply starts so, or `begun` is long enough already.
        """
        size = len(begun)
        if begun[: len(self.no)] == self.no[:size]:
            return self.no_chars - size
        if begun[: len(self.yes)] == self.yes[:size]:
            return self.yes_chars - size
        return 0
