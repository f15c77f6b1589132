"""Ctrl-C and SIGTERM: both raise KeyboardInterrupt; most commands then report their progress."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bridge.errors import BridgeError

EX_INTERRUPTED = 130  # as in shells: 128 plus the number of SIGINT


class StoppedError(BridgeError):
    """A command was interrupted before its end; the text says what was done. Exit status 130."""


@contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """Make SIGTERM raise KeyboardInterrupt within the block. For the main thread."""
    handler = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        # A command may have set its own handler: it stays until the end.
        if signal.getsignal(signal.SIGTERM) is signal.default_int_handler:
            signal.signal(signal.SIGTERM, handler)


@contextmanager
def saying(where: Callable[[], str]) -> Iterator[None]:
    """Turn an interruption of the block into a StoppedError; `where` returns the progress."""
    try:
        yield
    except KeyboardInterrupt:
        raise StoppedError(f"interrupted: {where()}") from None
