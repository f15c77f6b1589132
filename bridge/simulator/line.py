"""A simulated line: modules, an endpoint, and the thread that carries bytes between them."""

import os
import queue
import random
import select
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Self

from bridge.model import LineProtocol
from bridge.simulator.conversation import Conversation, Effect, HangUp
from bridge.simulator.dialect import Tongue
from bridge.simulator.endpoint import READ_AT_MOST, Endpoint
from bridge.simulator.faults import Faults
from bridge.simulator.module import SimulatedModule
from bridge.simulator.pty import PtyEndpoint
from bridge.simulator.recording import Recording
from bridge.simulator.wire import Direction, Pace, WireEntry, WireLog

CALL_PATIENCE_S = 5.0


class SimulatedLine:
    """Modules on one RS485 line, reachable from `start` (or `with`) to `stop`.

    One thread owns the endpoint and the conversation; other threads reach them through `_call`. Any
    thread may use modules, faults and log. `log` holds the pieces that were read and written; these
    are whole frames if the master writes them in one call.

    A master that sets another baud rate than that of the line is not understood if the endpoint can
    tell (a pty can, TCP cannot). `tap` is a second port that receives everything that passes, as a
    second adapter on the same wires would. `recording` answers in place of modules.
    """

    def __init__(
        self,
        protocol: LineProtocol | str,
        baud: int,
        modules: Iterable[SimulatedModule],
        *,
        paced: bool = True,
        turnaround_s: float = 0.002,
        endpoint: Endpoint | None = None,
        tap: PtyEndpoint | None = None,
        recording: Recording | None = None,
        tongue: Tongue | None = None,
        chance: random.Random | None = None,
        name: str = "line",
    ) -> None:
        self.name = name
        self.protocol = LineProtocol(protocol)
        self.baud = baud
        self.modules = {module.address: module for module in modules}
        self.faults = Faults(chance or random.Random())  # noqa: S311 - damage, not secrets
        self._endpoint = endpoint or PtyEndpoint(baud=baud)
        pace = Pace.of(self.protocol, baud, turnaround_s, paced=paced)
        self._tap = tap
        self._conversation = Conversation(
            self.protocol, self.modules, pace, self.faults, recording, tongue=tongue
        )
        self._log = WireLog()
        self._calls: queue.Queue[tuple[Callable[[], None], Future[None]]] = queue.Queue()
        self._wake: tuple[int, int] | None = None
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._up = False
        self._restore_at: float | None = None

    # --- for any thread ---

    @property
    def port(self) -> str:
        """Return the port as a configuration writes it."""
        return self._endpoint.port

    @property
    def log(self) -> tuple[WireEntry, ...]:
        """Return the last pieces on the wire, oldest first."""
        return self._log.entries()

    def module(self, address: int) -> SimulatedModule:
        """Return the module at a station."""
        return self.modules[address]

    def start(self) -> None:
        """Open the endpoint at `port` and start the thread.

        Raises OSError if that is not possible.
        """
        try:
            self._endpoint.open()
            if self._tap:
                self._tap.open()
        except OSError:
            self._close()  # what was opened so far
            raise
        self._up = True
        self._wake = os.pipe()
        self._thread = threading.Thread(
            target=self._run, args=(self._wake[0],), name=f"simulated {self.name}"
        )
        self._thread.start()

    def stop(self) -> None:
        """End the thread and close the endpoint. May be called twice."""
        if self._thread and self._wake:
            self._stopping.set()
            os.write(self._wake[1], b"!")
            self._thread.join()
            for descriptor in self._wake:
                os.close(descriptor)
            self._thread = self._wake = None
        self._close()

    def _close(self) -> None:
        self._endpoint.close()
        if self._tap:
            self._tap.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def hang_up(self) -> None:
        """Unplug the adapter: the program that uses the port sees a hang-up; the path is gone."""
        self._call(self._hang_up)

    def restore(self) -> None:
        """Plug the adapter in again: a new port at the same path."""
        self._call(self._restore)

    def inject(self, data: bytes) -> None:
        """Put unsolicited bytes on the wire."""
        self._call(lambda: self._conversation.inject(data, time.monotonic()))

    def _call(self, action: Callable[[], None]) -> None:
        """Run `action` in the thread of the line, and wait until it is done."""
        if not self._wake:
            raise RuntimeError(f"{self.name} is not running")
        future: Future[None] = Future()
        self._calls.put((action, future))
        os.write(self._wake[1], b"!")
        future.result(CALL_PATIENCE_S)

    # --- the line's thread ---

    def _run(self, wake: int) -> None:
        while not self._stopping.is_set():
            ready = self._wait(wake)
            self._do_calls()
            self._listen(ready)
            self._restore_when_due()
            for effect in self._conversation.advance(time.monotonic()):
                self._perform(effect)

    def _wait(self, wake: int) -> list[int]:
        """Wait for bytes, a call or an instant; return the descriptors with bytes."""
        # select: its time-out is not rounded up to milliseconds, which is the time of a character.
        ready, _, _ = select.select([wake, *self._endpoint.filenos()], [], [], self._nap_s())
        if wake in ready:
            os.read(wake, READ_AT_MOST)
            ready.remove(wake)
        return ready

    def _nap_s(self) -> float | None:
        now = time.monotonic()
        instants = (self._conversation.next_at(), self._restore_at)
        naps = [at - now for at in instants if at is not None]
        naps += [nap for module in self.modules.values() if (nap := module.settle()) is not None]
        return max(0.0, min(naps)) if naps else None

    def _do_calls(self) -> None:
        while not self._calls.empty():
            action, future = self._calls.get()
            try:
                action()
            except OSError as error:  # the port cannot be opened again: the caller gets the error
                future.set_exception(error)
            else:
                future.set_result(None)

    def _listen(self, ready: list[int]) -> None:
        for fileno in ready:
            if fileno not in self._endpoint.filenos():  # it hung up meanwhile
                continue
            data = self._endpoint.read(fileno)
            now = time.monotonic()
            if data:
                self._note(now, Direction.TO_MODULES, data)
            if data and self._endpoint.baud() in (None, self.baud):
                self._conversation.hear(data, now)

    def _perform(self, effect: Effect) -> None:
        if isinstance(effect, HangUp):
            self._hang_up()
            self._restore_at = time.monotonic() + effect.down_s
        elif self._up and not self._stopping.is_set():
            self._note(time.monotonic(), Direction.TO_MASTER, effect.data)
            self._endpoint.write(effect.data)

    def _note(self, at: float, direction: Direction, data: bytes) -> None:
        self._log.add(at, direction, data)
        if self._tap:
            self._tap.offer(data)

    def _hang_up(self) -> None:
        self._endpoint.hang_up()
        self._conversation.reset()
        self._up = False

    def _restore(self) -> None:
        self._restore_at = None
        if not self._up:
            self._endpoint.open()
            self._up = True

    def _restore_when_due(self) -> None:
        if self._restore_at is not None and time.monotonic() >= self._restore_at:
            self._restore()
