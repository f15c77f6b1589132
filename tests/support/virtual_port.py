"""A port in virtual time: a bus on it runs as fast as it can, and to the microsecond."""

from bisect import insort
from collections.abc import Callable, Iterable

Chunk = tuple[float, bytes]  # so many seconds after the request, these bytes
Answer = Callable[[bytes], Iterable[Chunk]]


class VirtualTime:
    """A clock that only sleeping and reading move on."""

    def __init__(self) -> None:
        self.now = 1000.0

    def clock(self) -> float:
        """Stands in for `time.monotonic`."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Stands in for `time.sleep`."""
        assert seconds > 0
        self.now += seconds


class VirtualPort:
    """Satisfies `Port`. `answer` tells what each request brings back, and how much later.

    Attributes:
        sent: When each request went out, and its bytes.
        closed: How often the port was closed.
    """

    name = "virtual"

    def __init__(self, time: VirtualTime, answer: Answer) -> None:
        self.time = time
        self.sent: list[Chunk] = []
        self.closed = 0
        self._answer = answer
        self._due: list[tuple[float, int, int]] = []  # when, in which order, which byte
        self._order = 0

    def arrive(self, at: float, data: bytes) -> None:
        """Schedules bytes for an instant."""
        for byte in data:
            self._order += 1
            insort(self._due, (at, self._order, byte))

    def write(self, data: bytes, deadline: float) -> None:
        """See `Port`."""
        assert self.time.now <= deadline
        self.sent.append((self.time.now, data))
        for delay_s, chunk in self._answer(data):
            self.arrive(self.time.now + delay_s, chunk)

    def read(self, count: int, deadline: float) -> bytes:
        """See `Port`."""
        taken = [due for due in self._due[:count] if due[0] <= max(deadline, self.time.now)]
        del self._due[: len(taken)]
        until = taken[-1][0] if len(taken) == count else deadline
        self.time.now = max(self.time.now, until)
        return bytes(byte for _, _, byte in taken)

    def discard(self) -> bytes:
        """See `Port`."""
        waiting = sum(at <= self.time.now for at, _, _ in self._due)
        return self.read(waiting, self.time.now) if waiting else b""

    def close(self) -> None:
        """See `Port`."""
        self.closed += 1


class Transcript:
    """An `Answer` by the book: these requests, in this order, with these replies."""

    def __init__(self, *lines: tuple[bytes, list[Chunk]]) -> None:
        self.left = list(lines)

    def __call__(self, frame: bytes) -> list[Chunk]:
        """Checks what is sent against the next line of the book."""
        expected, reply = self.left.pop(0)
        assert frame == expected
        return reply
