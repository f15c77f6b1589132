"""The server of the panel, in a thread of its own."""

import asyncio
import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import cast

from microdot import Microdot, Request

from bridge.bounded_log import BoundedLog, Cause
from bridge.config.schema import Server, WebConfig
from bridge.web.api import HandOver, PanelApi, cookie_name
from bridge.web.board import Board
from bridge.web.connection import HEAD_WITHIN_S, BoundedReader, PatientWriter
from bridge.web.door import Door
from bridge.web.guest import Route
from bridge.web.routes import Guard, add_routes, page_routes

_log = logging.getLogger(__name__)

MOST_CONNECTIONS = 64
_BEAT_S = 1.0
_RETRY_S = 10.0
_STOP_S = 1.0
_LINE_BYTES = 8 * 1024
# microdot reads the body of a request before any of our code sees it, unless it is longer than
# this: so it is read by the route, behind the door.
Request.max_body_length = 0
Request.max_content_length = 256 * 1024


class PanelServer:
    """Serves browsers. The main thread starts and stops it; everything else is in its own thread.

    Attributes:
        progress: The last sign of life of its thread, an instant of `clock`.
        routes: Everything that can be asked.
    """

    def __init__(
        self,
        web: WebConfig,
        *,
        board: Board,
        hand_over: HandOver,
        more: Iterable[Route],
        log: BoundedLog,
        clock: Callable[[], float],
    ) -> None:
        self._web = web
        self._board = board
        self._bounded = log
        self._clock = clock
        door = Door(web)
        self._api = PanelApi(web, board, door, hand_over, clock)
        self._app = Microdot()
        self.routes = (*page_routes(), *self._api.routes, *more)
        add_routes(self._app, self.routes, Guard(door, cookie_name(web), log, clock))
        self._open: OrderedDict[asyncio.StreamWriter, None] = OrderedDict()
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended: asyncio.Event | None = None
        self._failure: str | None = None
        self.progress = clock()

    def start(self) -> None:
        """Start the thread."""
        self.progress = self._clock()
        self._thread.start()

    def stop(self) -> None:
        """End it; browsers that are connected are cut off."""
        loop, ended = self._loop, self._ended
        if loop is not None and ended is not None and self._thread.is_alive():
            loop.call_soon_threadsafe(ended.set)
            self._thread.join(_STOP_S)

    def failure(self, stuck_before: float) -> str | None:
        """Return why the thread is not well, or None."""
        if not self._thread.is_alive():
            return f"the thread of the panel died: {self._failure}"
        return "the thread of the panel is stuck" if self.progress < stuck_before else None

    # --- in its own thread --------------------------------------------------------------------

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:  # noqa: BLE001  # ends the thread, and says so
            _log.exception("the thread of the panel ends")
            self._failure = repr(error)

    async def _serve(self) -> None:
        self._ended = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._api.attach(self._loop)
        self._board.call(self._api.wake)
        server: asyncio.Server | None = None
        retry_at = 0.0
        while not self._ended.is_set():
            self.progress = self._clock()
            if server is None and self.progress >= retry_at:
                server = await self._listen()
                retry_at = self.progress + _RETRY_S
            self._bounded.tick()
            try:
                async with asyncio.timeout(_BEAT_S):
                    await self._ended.wait()
            except TimeoutError:
                continue
        if server is not None:
            server.close()

    async def _listen(self) -> asyncio.Server | None:
        """Listen; where that cannot be, the bridge works on without, and tries again."""
        where = str(Server(self._web.host, self._web.port))
        try:
            server = await asyncio.start_server(
                self._connected, self._web.host, self._web.port, limit=_LINE_BYTES
            )
        except OSError as error:
            text = f"the panel cannot listen on {where}: {error.strerror}; it is tried again"
            self._bounded.tell(Cause.PANEL, where, logging.ERROR, text)
            return None
        self._bounded.end(Cause.PANEL, where, f"the panel listens on {where}", always=True)
        return server

    async def _connected(self, reader: asyncio.StreamReader, stream: asyncio.StreamWriter) -> None:
        while len(self._open) >= MOST_CONNECTIONS:
            oldest, _ = self._open.popitem(last=False)
            oldest.transport.abort()
        self._open[stream] = None
        writer = PatientWriter(
            stream, self._beat, lambda: self._open.pop(stream, None), self._clock()
        )
        try:
            await self._converse(reader, writer, stream)
        except (OSError, ValueError, IndexError, EOFError):
            stream.transport.abort()  # no HTTP, or it went away
        except asyncio.CancelledError:
            stream.transport.abort()  # at the end; asyncio would log a task that tells of it
        finally:
            self._open.pop(stream, None)

    async def _converse(
        self, reader: asyncio.StreamReader, writer: PatientWriter, stream: asyncio.StreamWriter
    ) -> None:
        peer = stream.get_extra_info("peername") or ("", 0)  # it went away at once
        async with asyncio.timeout(HEAD_WITHIN_S):
            request = await Request.create(
                self._app,
                cast("asyncio.StreamReader", BoundedReader(reader)),
                cast("asyncio.StreamWriter", writer),
                peer,
            )
        if request is None:
            stream.transport.abort()
            return
        response = await self._app.dispatch_request(request)
        await response.write(cast("asyncio.StreamWriter", writer))
        await writer.finish()

    def _beat(self) -> None:
        self.progress = self._clock()
