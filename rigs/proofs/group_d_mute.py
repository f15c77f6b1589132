"""Slow: D3, peers that are mute. Real ports and the real line worker."""

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any

from support.event_log import WAIT_S
from support.virtual_worker import make_line

from bridge.config.schema import LineConfig
from bridge.daemon.wiring import open_bus
from bridge.line.worker import LineWorker
from bridge.model import Command, LineChanged, LineEvent, LineProtocol, Verdict
from proofs.figures import Figure, Run, proof

FREE_WITHIN_S = 1.0
COMMAND_EVERY_S = 0.03


@contextmanager
def _mute_gateway() -> Iterator[str]:
    """Accepts connections, takes what it is sent, and says nothing."""
    over = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener, ExitStack() as stack:
        listener.settimeout(0.1)

        def accept() -> None:
            while not over.is_set():
                with suppress(TimeoutError):
                    stack.enter_context(listener.accept()[0])

        thread = threading.Thread(target=accept, name="mute gateway")
        thread.start()
        try:
            yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            over.set()
            thread.join()


@contextmanager
def _full_pty() -> Iterator[str]:
    """A pty whose master never reads: what is written to it has no place to go."""
    master, slave = os.openpty()
    os.set_blocking(slave, False)
    over = threading.Event()

    def fill() -> None:
        while not over.is_set():  # whoever opens and closes it empties it
            # To the last byte: a terminal that says that it is full takes a few more.
            with suppress(BlockingIOError):
                while os.write(slave, bytes(64)):
                    pass
            over.wait(0.005)

    thread = threading.Thread(target=fill, name="filler")
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        over.set()
        thread.join()
        os.close(slave)
        os.close(master)


@dataclass(slots=True)
class _Busy:
    """How long a line worker could not be reached.

    Attributes:
        verdict_s: From a command to its verdict, at the most.
        stop_s: From being told to stop to its end, at the most.
        commands: How many it was sent.
        causes: What was said of the port.
    """

    verdict_s: float = 0.0
    stop_s: float = 0.0
    commands: int = 0
    causes: set[str] = field(default_factory=set)

    @property
    def longest_s(self) -> float:
        """The longer of the two."""
        return max(self.stop_s, self.verdict_s)


def _watch(config: LineConfig, seconds: float, busy: _Busy) -> None:
    """Runs a line worker on a mute peer, commands it again and again, and stops it."""
    answered = threading.Event()

    def emit(event: LineEvent) -> None:
        if isinstance(event, Verdict):
            answered.set()
        if isinstance(event, LineChanged):
            busy.causes.add(event.detail)

    worker = LineWorker(config, emit, open_bus, time.monotonic)
    worker.start()
    until = time.monotonic() + seconds
    while (began := time.monotonic()) < until:
        answered.clear()
        worker.submit(Command("s1", "do/1", "ON", 1, 1, None, arrived=began, deadline=began + 2.0))
        assert answered.wait(WAIT_S)
        busy.commands += 1
        busy.verdict_s = max(busy.verdict_s, time.monotonic() - began)
        time.sleep(COMMAND_EVERY_S)
    began = time.monotonic()
    worker.stop()
    assert worker.join(WAIT_S)
    busy.stop_s = max(busy.stop_s, time.monotonic() - began)


@proof("D3")
def the_other_side_is_mute(run: Run) -> Figure:
    """Whoever says nothing, or takes nothing, holds the thread for a moment only."""
    times = run.scale.of(1, 20)
    seen = {}
    peers: dict[str, Callable[[], Any]] = {"gateway": _mute_gateway, "pty": _full_pty}
    for name, peer in peers.items():
        busy = seen[name] = _Busy()
        with peer() as port:
            for n in range(times):
                protocol = list(LineProtocol)[n % 3]
                config = replace(make_line(protocol=protocol), port=port)
                _watch(config, 0.8 + 0.13 * n, busy)
    commands = sum(busy.commands for busy in seen.values())
    return Figure(
        injected=f"mute gateway, full pty: {commands} commands, {2 * times} stops",
        seen="; ".join(f"{name}: {busy.longest_s:.2f} s at most" for name, busy in seen.items()),
        promised=f"thread free within {FREE_WITHIN_S:.0f} s",
        # Unless the pty was full, nothing was proved.
        kept=all(busy.longest_s <= FREE_WITHIN_S for busy in seen.values())
        and any("takes no bytes" in cause for cause in seen["pty"].causes),
    )
