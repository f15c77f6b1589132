"""One connection of a client, with a bound on all that it can ask of us."""

import asyncio
import errno
from collections.abc import Callable

HEAD_WITHIN_S = 5.0  # request line and headers
TAKES_WITHIN_S = 20.0  # what was sent, until there is room for more
_HEAD_BYTES = 16 * 1024
_HIGH_WATER_BYTES = 16 * 1024


class BoundedReader:
    """Reads a request for microdot, which has no bound on the number of headers."""

    def __init__(self, reader: asyncio.StreamReader) -> None:
        self._reader = reader
        self._left = _HEAD_BYTES

    async def readline(self) -> bytes:
        """Return one line of the head; raises ValueError where it is too long."""
        line = await self._reader.readline()
        self._left -= len(line)
        if self._left < 0:
            raise ValueError("the head of the request is too long")
        return line

    async def readexactly(self, count: int) -> bytes:
        """Return so many bytes of the body."""
        return await self._reader.readexactly(count)


class PatientWriter:
    """Writes an answer for microdot; a client that takes nothing is left after 20 s.

    The head goes out in one piece. `progress` is called before each wait, `stay` by what will
    write for long; `opened_at` is when the connection was taken.
    """

    def __init__(
        self,
        writer: asyncio.StreamWriter,
        progress: Callable[[], None],
        stay: Callable[[], None],
        opened_at: float,
    ) -> None:
        self.opened_at = opened_at
        self._writer = writer
        self._progress = progress
        self.stay = stay
        self._head = bytearray()
        self._has_head = False
        writer.transport.set_write_buffer_limits(high=_HIGH_WATER_BYTES)

    async def awrite(self, data: bytes) -> None:
        """Write, and wait until there is room for more."""
        if not self._has_head:
            self._head += data
            self._has_head = data == b"\r\n"
            return
        self._flush_head()
        self._writer.write(data)
        await self._drain()

    async def finish(self) -> None:
        """Write what is left, and close."""
        self._flush_head()
        await self._drain()
        self._writer.close()

    def _flush_head(self) -> None:
        if self._head:
            self._writer.write(bytes(self._head))
            self._head.clear()

    async def _drain(self) -> None:
        self._progress()
        try:
            async with asyncio.timeout(TAKES_WITHIN_S):
                await self._writer.drain()
        except TimeoutError:
            self._writer.transport.abort()
            raise BrokenPipeError(errno.EPIPE, "the client takes nothing") from None
