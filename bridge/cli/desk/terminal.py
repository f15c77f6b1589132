"""The terminal at which a panel is shown."""

import os
import select
import signal
import threading

_STDIN = 0


def end_with_terminal() -> None:
    """End by SIGHUP once the terminal hangs up: its window or its connection is closed.

    A program without a controlling terminal does not get this signal from the kernel. Then textual
    would read the closed terminal without a pause, and its next write would wait for ever. The main
    thread calls this: SIGHUP counts also where the caller ignores it (`nohup`).
    """
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    threading.Thread(target=_end_at_hang_up, name="terminal", daemon=True).start()


def _end_at_hang_up() -> None:
    poller = select.poll()
    poller.register(_STDIN, 0)  # it wakes for nothing but the end of the terminal
    if any(event & select.POLLHUP for _, event in poller.poll()):
        os.kill(os.getpid(), signal.SIGHUP)
