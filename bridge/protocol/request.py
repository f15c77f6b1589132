"""What every request offers: its bytes, and how to read its own reply."""

from typing import Protocol, TypeVar

T_co = TypeVar("T_co", covariant=True)


class Request(Protocol[T_co]):
    """A request that knows its frame and reads its own reply. Immutable: built once, sent often."""

    @property
    def station(self) -> int:
        """Return the station that is asked, 0-31."""
        ...

    @property
    def frame(self) -> bytes:
        """Return the whole frame as it goes on the wire."""
        ...

    @property
    def reply_chars(self) -> int:
        """Characters of the reply that says yes: feeds deadlines and plans."""
        ...

    def missing(self, buffer: bytes) -> int:
        """Tell how many bytes are still due at the least: read exactly that many.

        Never more than what is left of the shortest reply that `buffer` can begin, so that
        reading it cannot wait for bytes that are not sent. 0 when `decode` can judge.
        """
        ...

    def decode(self, buffer: bytes) -> T_co | None:
        """Read the reply, with noise around it tolerated.

        Returns:
            The value, or None for "not yet": more bytes may complete the reply.

        Raises:
            RefusedError: A valid answer that says no.
            BadReplyError: More bytes can never make this a reply to this request.
        """
        ...
