"""The interface of a request: it knows its frame and reads its own reply."""

from typing import Protocol, TypeVar

T_co = TypeVar("T_co", covariant=True)


class Request(Protocol[T_co]):
    """A request that knows its frame and reads its own reply. Immutable: built once, sent often."""

    @property
    def address(self) -> int:
        """Return the address of the module, 0-31."""

    @property
    def frame(self) -> bytes:
        """Return the whole frame as it is sent."""

    @property
    def reply_chars(self) -> int:
        """Return the length of the good reply, from which deadlines and plans are computed."""

    def missing(self, buffer: bytes) -> int:
        """Return how many bytes are missing at least: the caller reads exactly that many.

        This is the rest of the shortest reply that can begin with `buffer`, so a read of that many
        bytes never waits for bytes that are not sent. 0 means that `decode` can decide.
        """

    def decode(self, buffer: bytes) -> T_co | None:
        """Return the value of the reply; noise around the reply is tolerated.

        Returns:
            The value, or None if more bytes may complete the reply.

        Raises:
            RefusedError: The module refuses.
            BadReplyError: More bytes cannot make this a reply to this request.
        """
