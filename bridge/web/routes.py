"""The one way to add a route: each passes the door, and all answers have the same headers."""

import asyncio
import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from microdot import Microdot, Request, Response

from bridge.bounded_log import BoundedLog, Cause
from bridge.web.door import Door, Knock, Level
from bridge.web.guest import Guest, Route

if TYPE_CHECKING:
    from bridge.web.connection import PatientWriter

BODY_WITHIN_S = 10.0
_TOO_MANY = 429  # wrong keys

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'self'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
_TYPES = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
    "json": "application/json",
}


@dataclass(frozen=True, slots=True)
class Guard:
    """What every route is behind; `cookie` is the name of that of a session."""

    door: Door
    cookie: str
    log: BoundedLog
    clock: Callable[[], float]


def add_routes(app: Microdot, routes: Iterable[Route], guard: Guard) -> None:
    """Add every route, and what is said where there is none."""
    for route in routes:
        app.route(route.path, methods=[route.method])(_guarded(route, guard))
    for status, text in (
        (404, "there is nothing here"),
        (405, "not this method"),
        (413, "too long"),
    ):
        app.errorhandler(status)(_says(status, text))
    app.options_handler = _no_options


def page_routes() -> tuple[Route, ...]:
    """Return a route for each file of the page: no path is ever made of what was asked for."""
    folder = Path(__file__).parent / "static"
    routes = [_file(f"/{one.name}", one.read_bytes()) for one in folder.iterdir() if one.is_file()]
    routes.append(_file("/", (folder / "index.html").read_bytes(), "html"))
    return tuple(routes)


def _file(path: str, content: bytes, kind: str | None = None) -> Route:
    headers = {"Content-Type": _TYPES[kind or path.rpartition(".")[2]]}

    async def handle(_: Guest) -> Any:
        return content, 200, headers

    return Route("GET", path, Level.OPEN, handle)


def _guarded(route: Route, guard: Guard) -> Callable[..., Any]:
    async def guarded(request: Request) -> Response:
        knock = _knock(request, guard.cookie)
        response = _response(await _answer(request, route, guard, knock))
        if response.status_code == _TOO_MANY:
            text = f"too many wrong keys for the panel come from {knock.address}: they have to wait"
            guard.log.tell(Cause.PANEL, "keys", logging.WARNING, text)
        return response

    return guarded


async def _answer(request: Request, route: Route, guard: Guard, knock: Knock) -> Any:
    """Return what the route says to one who is let in; else why he is not."""
    door, clock = guard.door, guard.clock
    if denied := door.objection(knock, route.level, clock()):
        return {"error": denied.error}, denied.status
    if not 0 <= request.content_length <= route.most_bytes:
        return {"error": f"at most {route.most_bytes} bytes are read"}, 413
    try:
        body = await _body(request)
    except (TimeoutError, asyncio.IncompleteReadError):
        return {"error": "the body of the request is not complete"}, 408
    at = cast("PatientWriter", request.sock[1]).opened_at
    try:
        return await route.handle(Guest(request, knock, door.level(knock, clock()), at, body))
    except Exception as error:  # noqa: BLE001  # one request fails, and the panel works on
        text = f"{route.method} {route.path} failed: {error!r:.200}"
        guard.log.tell(Cause.PANEL, route.path, logging.ERROR, text)
        return {"error": "this failed: the log of the bridge says why"}, 500


async def _body(request: Request) -> bytes:
    async with asyncio.timeout(BODY_WITHIN_S):
        stream = cast("asyncio.StreamReader", request.stream)
        return await stream.readexactly(request.content_length)


def _knock(request: Request, cookie: str) -> Knock:
    address = str(request.client_addr[0])
    headers = {name.lower(): value for name, value in request.headers.items()}
    return Knock(address, request.method.upper(), headers, request.cookies.get(cookie))


def _response(answer: Any) -> Response:
    match answer:
        case Response():
            made = answer
        case tuple():
            made = Response(*answer)
        case _:
            made = Response(answer)
    for name, value in HEADERS.items():
        made.headers[name] = value
    return made


def _no_options(_: Request) -> dict[str, str]:
    """Return no permission: pages of other sites ask for it in vain."""
    return dict(HEADERS)


def _says(status: int, text: str) -> Callable[[Request], Any]:
    async def say(_: Request) -> Response:
        return _response(({"error": text}, status))

    return say
