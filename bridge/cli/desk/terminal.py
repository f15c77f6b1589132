"""The terminal at which a panel is shown."""

import select
import signal

_STDIN = 0


def end_with_terminal() -> None:
    """End by SIGHUP if the terminal hung up: its window or its connection was closed.

    A program without a controlling terminal does not get this signal from the kernel. Then textual
    would read the closed terminal without a pause, and would wait for ever when asked to exit.
    """
    poller = select.poll()
    poller.register(_STDIN, 0)
    if any(event & select.POLLHUP for _, event in poller.poll(0)):
        signal.raise_signal(signal.SIGHUP)
