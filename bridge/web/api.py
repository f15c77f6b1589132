"""What the routes of the panel answer. Only the thread of the panel calls it."""

import asyncio
import json
import secrets
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, cast

from microdot import Response

from bridge.config.schema import WebConfig
from bridge.errors import CommandError
from bridge.mqtt.strict_json import object_of
from bridge.web.board import Board, News
from bridge.web.commands import Wish, read_wish
from bridge.web.door import Denied, Door, Level
from bridge.web.guest import Guest, Route, call_in

if TYPE_CHECKING:
    from bridge.web.connection import PatientWriter

MOST_BROWSERS = 40
BEAT_S = 5.0
_PIECE_BYTES = 16 * 1024
PACE_S = 0.02  # between two pushes to one browser
# A command has its verdict after its deadline, 60 s at most, and the exchanges that it takes.
VERDICT_WITHIN_S = 90.0
# Without a sign of life for so long the main thread is stuck; else it ends the process for others.
STUCK_AFTER_S = 25.0

Answer = Callable[[int, Mapping[str, Any]], None]
HandOver = Callable[[Wish, float, Answer], None]


class PanelApi:
    """The routes below `api/`, and what they need."""

    def __init__(
        self,
        web: WebConfig,
        board: Board,
        door: Door,
        hand_over: HandOver,
        clock: Callable[[], float],
    ) -> None:
        self._board = board
        self._door = door
        self._hand_over = hand_over
        self._clock = clock
        self._cookie = cookie_name(web)
        self._run = secrets.token_hex(4)  # a browser sees by it that the bridge was started anew
        self._loop: asyncio.AbstractEventLoop | None = None
        self._news = asyncio.Event()
        self._browsers = 0

    @property
    def routes(self) -> tuple[Route, ...]:
        """Return all routes of the interface."""
        return (
            Route("POST", "/api/login", Level.OPEN, self._log_in, 4096),
            Route("POST", "/api/logout", Level.OPEN, self._log_out, 16),
            Route("GET", "/api/state", Level.LOOK, self._state),
            Route("GET", "/api/events", Level.LOOK, self._events),
            Route("POST", "/api/command", Level.SWITCH, self._command, 4096),
            Route("GET", "/health", Level.OPEN, self._health),
            Route("GET", "/metrics", Level.LOOK, self._metrics),
        )

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take the loop that all of it runs in."""
        self._loop = loop

    def wake(self) -> None:
        """Tell every browser that something is new. Any thread may call it."""
        if self._loop is not None:
            call_in(self._loop, self._wake_all)

    def _wake_all(self) -> None:
        self._news.set()
        self._news = asyncio.Event()

    # --- keys ---------------------------------------------------------------------------------

    async def _log_in(self, guest: Guest) -> Any:
        key = object_of(guest.body).get("password")
        if not isinstance(key, str) or not key:
            return {"error": "password is a text"}, 400
        session = self._door.log_in(guest.knock, key, self._clock())
        if isinstance(session, Denied):
            return {"error": session.error}, session.status
        # Without a path: then it goes to where it was set, below whatever a proxy puts in front.
        cookie = f"{self._cookie}={session}; HttpOnly; SameSite=Strict; Max-Age=604800"
        return {}, 200, {"Set-Cookie": cookie}

    async def _log_out(self, guest: Guest) -> Any:
        if guest.knock.session is not None:
            self._door.log_out(guest.knock.session)
        gone = f"{self._cookie}=; HttpOnly; SameSite=Strict; Max-Age=0"
        return {}, 200, {"Set-Cookie": gone}

    # --- what there is ------------------------------------------------------------------------

    async def _state(self, guest: Guest) -> Any:
        news = self._board.since(0)
        return {
            **self._hello(guest),
            "state": {entry.key: entry.document for entry in news.state},
            "happened": [entry.document for entry in news.noted if entry.key == "happened"],
        }

    def _hello(self, guest: Guest) -> dict[str, Any]:
        return {
            "run": self._run,
            "now": self._clock(),
            "may_switch": guest.level >= Level.SWITCH,
            "has_session": guest.knock.session is not None,
        }

    async def _events(self, guest: Guest) -> Any:
        if self._browsers >= MOST_BROWSERS:
            return {"error": f"{MOST_BROWSERS} browsers are connected: close one"}, 503
        cast("PatientWriter", guest.request.sock[1]).stay()
        stream = self._told(guest)
        headers = {"Content-Type": "text/event-stream", "X-Accel-Buffering": "no"}
        return Response(cast("bytes", stream), 200, headers)

    async def _told(self, guest: Guest) -> AsyncIterator[bytes]:
        """Tell everything first, then what is new; what came meanwhile is told once."""
        self._browsers += 1
        try:
            yield event("hello", json.dumps(self._hello(guest)))
            serial, beat_at = 0, self._clock() + BEAT_S
            while True:
                awaited = self._news  # before it is looked: what comes after sets this one
                news = self._board.since(serial)
                for piece in _pieces(news):
                    yield piece
                now = self._clock()
                if now >= beat_at:
                    beat_at = now + BEAT_S
                    yield event("beat", json.dumps({"now": now}))
                if news.serial == serial:
                    await _wait(awaited, beat_at - now)
                else:
                    serial = news.serial
                    await asyncio.sleep(PACE_S)
        finally:
            self._browsers -= 1

    # --- commands -----------------------------------------------------------------------------

    async def _command(self, guest: Guest) -> Any:
        try:
            wish = read_wish(guest.body, self._run)
        except CommandError as error:
            return {"status": "refused", "reason": error.reason, "detail": error.detail}, 400
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[tuple[Mapping[str, Any], int]] = loop.create_future()

        def answer(status: int, document: Mapping[str, Any]) -> None:
            call_in(loop, _settle, answered, (document, status))

        self._hand_over(wish, guest.at, answer)
        try:
            async with asyncio.timeout(VERDICT_WITHIN_S):
                document, status = await answered
        except TimeoutError:
            return {"error": "there is no verdict: the bridge is being stopped"}, 504
        return dict(document), status

    # --- for machines -------------------------------------------------------------------------

    async def _health(self, guest: Guest) -> Any:
        """Tell a watchdog, which has no key, whether the bridge is well; all else wants the key."""
        is_well = self._clock() - self._board.progress < STUCK_AFTER_S
        told = {"status": "ok" if is_well else "not ok"}
        if guest.level >= Level.LOOK:
            states = {entry.key: entry.document for entry in self._board.since(0).state}
            told["broker"] = states["bridge"]["broker"]
        return told, 200 if is_well else 503

    async def _metrics(self, _: Guest) -> Any:
        from bridge.web.metrics import metrics  # noqa: PLC0415  # most never ask for it

        states = {entry.key: entry.document for entry in self._board.since(0).state}
        content = "application/openmetrics-text; version=1.0.0; charset=utf-8"
        return metrics(states), 200, {"Content-Type": content}


def cookie_name(web: WebConfig) -> str:
    """Return the name of the cookie: browsers keep those of all ports of a host together."""
    return f"wisco2mqtt_{web.port}"


def event(name: str, text: str) -> bytes:
    """Return one server-sent event; JSON has no line breaks."""
    return f"event: {name}\ndata: {text}\n\n".encode("utf-8", errors="replace")


def _pieces(news: News) -> Iterator[bytes]:
    """Return the events, some at a time: all of them at once, for each browser, take megabytes."""
    made = bytearray()
    for one in _events_of(news):
        made += one
        if len(made) >= _PIECE_BYTES:
            yield bytes(made)
            made.clear()
    if made:
        yield bytes(made)


def _events_of(news: News) -> Iterator[bytes]:
    for entry in news.state:
        yield event("state", f'{{"key":{json.dumps(entry.key)},"value":{entry.text}}}')
    for entry in news.noted:
        yield event(entry.key, entry.text)


async def _wait(awaited: asyncio.Event, most_s: float) -> None:
    """Wait for news, or until the next beat is due."""
    try:
        async with asyncio.timeout(most_s):
            await awaited.wait()
    except TimeoutError:
        pass


def _settle(answered: "asyncio.Future[Any]", result: object) -> None:
    if not answered.done():
        answered.set_result(result)
