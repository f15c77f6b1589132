"""Ctrl-C and SIGTERM: both are a KeyboardInterrupt, and a command with an end says where it was."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bridge.errors import BridgeError

EX_INTERRUPTED = 130  # as shells have it: 128, and the number of SIGINT


class StoppedError(BridgeError):
    """A command that has an end was interrupted before it; says what was done: exit 130."""


@contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """For the length of the block; the main thread's own."""
    handler = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        # A command may have set a handler of its own: that one stays to the very end.
        if signal.getsignal(signal.SIGTERM) is signal.default_int_handler:
            signal.signal(signal.SIGTERM, handler)


@contextmanager
def saying(where: Callable[[], str]) -> Iterator[None]:
    """Turn an interruption of the block into a StoppedError; `where` tells how far it was."""
    try:
        yield
    except KeyboardInterrupt:
        raise StoppedError(f"interrupted: {where()}") from None
