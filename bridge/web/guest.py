"""A request that was let in, and the description of a route."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from microdot import Request

from bridge.web.door import Knock, Level


@dataclass(frozen=True, slots=True)
class Guest:
    """A request that was let in.

    Attributes:
        request: As the library has it.
        knock: As the door saw it.
        level: What it may do.
        at: When its connection was taken (`bridge.clock.boot_s`).
        body: What was read of it, no longer than its route takes.
    """

    request: Request
    knock: Knock
    level: Level
    at: float
    body: bytes


@dataclass(frozen=True, slots=True)
class Route:
    """One route: who may ask it, and how long its body may be."""

    method: str
    path: str
    level: Level
    handle: Callable[[Guest], Any]
    most_bytes: int = 0


def call_in(loop: asyncio.AbstractEventLoop, call: Callable[..., Any], *arguments: Any) -> None:
    """Call it in the thread of the panel. Any thread may ask; one that has ended takes nothing."""
    with suppress(RuntimeError):  # the loop is closed: the main thread must not end by it
        loop.call_soon_threadsafe(call, *arguments)
