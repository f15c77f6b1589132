"""The console of `simulate`: orders on stdin, messages on stdout."""

import os
import queue
import select
import signal
import sys
from collections.abc import Callable, Mapping
from typing import Self

from bridge.simulator.control import ControlError, read_order, show
from bridge.simulator.line import SimulatedLine

_READ_AT_MOST = 4096
_LONGEST_ORDER = 1000


class Console:
    """Reads orders and prints messages. The main thread owns it; other threads only call `post`."""

    def __init__(self) -> None:
        self._news: queue.Queue[str] = queue.Queue()
        self._bell = (-1, -1)
        self._stdin: int | None = None
        self._typed = b""
        self._wakeup_before = -1

    def __enter__(self) -> Self:
        self._bell = os.pipe()
        for descriptor in self._bell:
            os.set_blocking(descriptor, False)
        # A signal wakes it too: its handler alone would not end the wait in `attend`.
        self._wakeup_before = signal.set_wakeup_fd(self._bell[1], warn_on_full_buffer=False)
        self._stdin = sys.stdin.fileno() if sys.stdin else None
        return self

    def __exit__(self, *_: object) -> None:
        signal.set_wakeup_fd(self._wakeup_before)
        for descriptor in self._bell:
            os.close(descriptor)

    def post(self, text: str) -> None:
        """Print a line of text, from any thread."""
        self._news.put(text)
        self._ring()

    def attend(self, lines: Mapping[str, SimulatedLine], stopped: Callable[[], object]) -> None:
        """Take orders and print messages until `stopped` returns something."""
        while not stopped():
            watched = [self._bell[0]] if self._stdin is None else [self._bell[0], self._stdin]
            ready, _, _ = select.select(watched, [], [])
            if self._bell[0] in ready:
                os.read(self._bell[0], _READ_AT_MOST)
            if self._stdin in ready:
                self._take_orders(lines)
            self._print_news()

    def _ring(self) -> None:
        try:
            os.write(self._bell[1], b"!")
        except BlockingIOError:
            return  # it is awake already

    def _print_news(self) -> None:
        while not self._news.empty():
            print(self._news.get(), flush=True)

    def _take_orders(self, lines: Mapping[str, SimulatedLine]) -> None:
        data = os.read(sys.stdin.fileno(), _READ_AT_MOST)
        if not data:
            self._stdin = None  # stdin has ended: the modules continue
        *orders, self._typed = (self._typed + data).split(b"\n")
        self._typed = self._typed[:_LONGEST_ORDER]
        for order in orders:
            if order.strip():
                _carry_out(order.decode(errors="replace").strip(), lines)


def _carry_out(order: str, lines: Mapping[str, SimulatedLine]) -> None:
    if order == "show":
        print(*show(lines), sep="\n", flush=True)
        return
    try:
        read_order(order, lines).do()
    except ControlError as error:
        print(error, file=sys.stderr, flush=True)
