"""Ctrl-C and SIGTERM: both raise KeyboardInterrupt; most commands then report their progress."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

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
def interrupts_kept() -> Iterator[Callable[[], bool]]:
    """Keep Ctrl-C and SIGTERM from breaking into the block; yield what says that one came.

    The block ends itself, so that nothing is lost half-way. A second one raises KeyboardInterrupt:
    the block may hang, as in a full pipe. For the main thread.
    """
    came = False

    def keep(number: int, frame: FrameType | None) -> None:
        nonlocal came
        if came:
            signal.default_int_handler(number, frame)
        came = True

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    heard = {number: handler for number, handler in before.items() if handler != signal.SIG_IGN}
    for number in heard:  # a program in the background of a script ignores SIGINT
        signal.signal(number, keep)
    try:
        yield lambda: came
    finally:
        for number, handler in heard.items():
            signal.signal(number, handler)


@contextmanager
def saying(where: Callable[[], str]) -> Iterator[None]:
    """Turn an interruption of the block into a StoppedError; `where` returns the progress."""
    try:
        yield
    except KeyboardInterrupt:
        raise StoppedError(f"interrupted: {where()}") from None
