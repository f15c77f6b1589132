"""The first bytes of a good reply and of a refusal, and how many bytes are still missing."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Expected:
    """The fixed first bytes of the good reply and of the refusal.

    Attributes:
        yes: First bytes of the good reply, as far as they are known in advance.
        yes_chars: Length of the good reply.
        no: First bytes of a refusal.
        no_chars: Length of a refusal, which is never longer than the good reply.
    """

    yes: bytes
    yes_chars: int
    no: bytes
    no_chars: int

    def left(self, begun: bytes) -> int:
        """Return how many bytes are missing of the shortest reply that starts with `begun`.

        The result is 0 or less if no reply starts like this, or if `begun` is long enough.
        """
        size = len(begun)
        if begun[: len(self.no)] == self.no[:size]:
            return self.no_chars - size
        if begun[: len(self.yes)] == self.yes[:size]:
            return self.yes_chars - size
        return 0
