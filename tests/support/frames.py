"""Feeds a reply to a request in every way in which a line may bring it."""

from dataclasses import dataclass
from typing import TypeVar

from bridge.errors import BadReplyError, RefusedError
from bridge.protocol.request import Request

T = TypeVar("T")

# No byte of it starts a reply in any of the protocols, nor is it a station, 1-31.
NOISE = b"\x00\xff\xee"
TRAILING = b"\x00\r\nDO>OK\r:01\n\x01\x02\x02"


@dataclass(frozen=True, slots=True)
class Decided:
    """The result of a decode: a value or an error, and the number of bytes that it took."""

    value: object
    error: Exception | None
    size: int

    def agrees(self, other: "Decided") -> bool:
        """Return whether both ended alike, whatever the number of bytes."""
        if isinstance(self.error, RefusedError) and isinstance(other.error, RefusedError):
            return (self.error.code, self.error.name) == (other.error.code, other.error.name)
        return type(self.error) is type(other.error) and self.value == other.value


def judge(request: Request[T], buffer: bytes) -> Decided | None:
    """Decodes `buffer`, and checks that `missing` and `decode` agree on whether that is due."""
    due = request.missing(buffer)
    assert due >= 0
    try:
        value = request.decode(buffer)
    except BadReplyError as error:
        assert due == 0
        assert error.data == buffer  # noqa: PT017  # which error comes is not known beforehand
        return Decided(None, error, len(buffer))
    except RefusedError as error:
        assert due == 0
        return Decided(None, error, len(buffer))
    if due:
        assert value is None
        return None
    return Decided(value, None, len(buffer))


def fed_whole(request: Request[T], stream: bytes) -> Decided | None:
    """All bytes at once."""
    return judge(request, stream)


def fed_bytewise(request: Request[T], stream: bytes) -> Decided | None:
    """One byte after the other, up to the decision."""
    for size in range(len(stream) + 1):
        if decided := judge(request, stream[:size]):
            return decided
    return None


def fed_as_asked(request: Request[T], stream: bytes) -> Decided | None:
    """Decode with as many bytes as `missing` asks for; at the end of the stream decide too."""
    size = 0
    while size < len(stream):
        if decided := judge(request, stream[:size]):
            return decided
        size += request.missing(stream[:size])
    return judge(request, stream[:size])


def all_ways(request: Request[T], reply: bytes) -> T:
    """Reads `reply` whole, byte by byte, as asked, behind noise and before trailing bytes.

    All ways must end alike, and a good reply without noise with its very last byte, of which
    `missing` asks for none too many.
    Returns the value or raises the error that they agree on.
    """
    whole = fed_whole(request, reply)
    assert whole is not None, f"undecided: {reply!r}"
    ways = (
        fed_bytewise(request, reply),
        fed_as_asked(request, reply + TRAILING),
        fed_whole(request, NOISE + reply),
        fed_bytewise(request, NOISE + reply),
        fed_whole(request, reply + TRAILING),
        fed_whole(request, NOISE + reply + TRAILING),
        fed_bytewise(request, NOISE + reply + TRAILING),
        fed_as_asked(request, NOISE + reply + TRAILING),
    )
    for decided in ways:
        assert decided is not None
        assert decided.agrees(whole), (decided, whole)
    bytewise, as_asked, *_ = (decided.size for decided in ways if decided)
    if not isinstance(whole.error, BadReplyError):
        assert bytewise == as_asked == len(reply)
    if whole.error:
        raise whole.error
    return whole.value  # type: ignore[return-value]  # what `decode` of a Request[T] returned
