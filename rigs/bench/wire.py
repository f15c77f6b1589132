"""Paced lines of DIO100s in their own process, and a record of what passed on them.

Bytes take their time. Modules wait for the silence that ends an RTU frame and for their turnaround.
Requests that come too early are answered and counted: during the silence, or during another frame.
The process asks for real-time priority, because a wire does not wait.
"""

import ctypes
import heapq
import multiprocessing
import os
import random
import select
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Self

from bench.arithmetic import Physics
from bridge.model import DIO100, LineProtocol, ModuleType
from bridge.simulator import modbus, wisco
from bridge.simulator.framing import LEAST_SILENCE_S, framer_for
from bridge.simulator.module import SimulatedModule
from bridge.simulator.pty import PtyEndpoint

_SPIN_S = 0.00015  # a sleep ends this much late at times: the rest of a wait is spent looking
_PRIORITY = 10
_PR_SET_TIMERSLACK = 29
_READ_AT_MOST = 4096
_PATIENCE_S = 20.0


@dataclass(frozen=True, slots=True)
class LineSpec:
    """One line: which stations are on it, and which of them say nothing.

    `lost` is the share of the replies that do not arrive, by chance.
    """

    protocol: str
    baud: int
    physics: Physics
    stations: tuple[int, ...]
    dead: frozenset[int] = frozenset()
    model: ModuleType = DIO100
    lost: float = 0.0


@dataclass(slots=True)
class Seen:
    """The record of all lines. Instants are of `time.monotonic()`, which processes share.

    Attributes:
        reads: Instant, line, station, and `inputs`, `outputs` or `other`, of each request.
        writes: Instant, line, station, and all outputs after the write.
        toggles: Instant, line, station, input, and its new value.
        early: Requests that came before the end of the silence after the last reply.
        overlapping: Requests that came while a request or a reply was on the wire.
        unanswered: Requests without a reply.
    """

    reads: list[tuple[float, int, int, str]] = field(default_factory=list)
    writes: list[tuple[float, int, int, int]] = field(default_factory=list)
    toggles: list[tuple[float, int, int, int, bool]] = field(default_factory=list)
    early: int = 0
    overlapping: int = 0
    unanswered: int = 0


class Wire:
    """The process with the lines, as others see it. Use it with `with`."""

    def __init__(self, specs: Sequence[LineSpec]) -> None:
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, tuple(specs)), daemon=True)
        self.ports: list[str] = []

    def __enter__(self) -> Self:
        self._process.start()
        self.ports = self._answer()
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.send(("stop",))
        self._process.join(_PATIENCE_S)

    def begin(self) -> None:
        """Forgets what was seen so far."""
        self._ask("begin")

    def take(self) -> Seen:
        """Return the record since `begin`."""
        seen = self._ask("take")
        assert isinstance(seen, Seen)
        return seen

    def toggle(self, each_s: float) -> None:
        """From now on an input of some station changes about so often; 0: none does."""
        self._ask("toggle", each_s)

    def switch(self, line: int, address: int, output: int, on: bool) -> float:
        """Switches an output as another master would; returns when that was."""
        at = self._ask("switch", line, address, output, on)
        assert isinstance(at, float)
        return at

    def kill(self, line: int, stations: frozenset[int]) -> float:
        """From now on these say nothing, and no others; returns when that was."""
        at = self._ask("kill", line, stations)
        assert isinstance(at, float)
        return at

    def outputs(self, line: int) -> dict[int, int]:
        """Return the relays of each station."""
        outputs = self._ask("outputs", line)
        assert isinstance(outputs, dict)
        return outputs

    def _ask(self, *words: Any) -> Any:
        self._ours.send(words)
        return self._answer()

    def _answer(self) -> Any:
        assert self._ours.poll(_PATIENCE_S), "the process with the lines does not answer"
        return self._ours.recv()


# --- inside that process -----------------------------------------------------------------------


def _serve(orders: Connection, specs: tuple[LineSpec, ...]) -> None:
    with suppress(OSError):  # without the privilege the figures are a little less sharp
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    _Lines(orders, specs).run()


class _Line:
    """One line: its modules, and when its wire is free."""

    def __init__(self, index: int, spec: LineSpec) -> None:
        self.endpoint = PtyEndpoint(baud=spec.baud)
        self.endpoint.open()
        self.modules = {address: SimulatedModule(spec.model, address) for address in spec.stations}
        self.dead = spec.dead
        self._lost = spec.lost
        self._chance = random.Random(spec.protocol)  # noqa: S311
        self.index = index
        self._rtu = spec.protocol == LineProtocol.MODBUS_RTU
        self._framer = framer_for(LineProtocol(spec.protocol))
        self._physics = spec.physics
        self._replies: dict[bytes, tuple[int, str, bytes]] = {}
        self._held = False
        self._heard_at = 0.0
        self._request_until = 0.0
        self._frame = b""
        self._reply = b""
        self._reply_from = 0.0
        self._reply_until = 0.0

    def hear(self, data: bytes, now: float, seen: Seen) -> float | None:
        """Takes what was written; returns when the last bit of the reply has passed."""
        self._judge_gap(now, seen)
        heard_before, self._heard_at = self._heard_at, now
        self._request_until = max(now, self._request_until) + len(data) * self._physics.character_s
        known = None if self._held else self._replies.get(data)
        if known is None:
            if now - heard_before > LEAST_SILENCE_S:
                self._framer.silence()  # what was begun before is no part of this
            frames = self._framer.feed(data)
            self._held = not frames
            if not frames:
                return None
            data = frames[-1]
            known = self._answer(data, now, seen)
        address, kind, reply = known
        if address in self.dead or self._chance.random() < self._lost:
            reply = b""
        seen.reads.append((now, self.index, address, kind))
        if not reply:
            seen.unanswered += 1
            return None
        physics = self._physics
        self._frame, self._reply = data, reply
        self._reply_from = self._request_until + physics.silence_s + physics.turnaround_s
        self._reply_until = self._reply_from + len(reply) * physics.character_s
        return self._reply_until

    def speak(self, fileno: int) -> None:
        """Hands the reply over: only now can its reader know that it ended."""
        self._reply_until = time.monotonic()
        os.write(fileno, self._reply)

    def changed(self, now: float) -> None:
        """A module changed. It looks at its channels when it begins to speak."""
        self._replies.clear()
        if now < self._reply_from:
            self._reply = self._answer_of(self._frame) or b""

    def _judge_gap(self, now: float, seen: Seen) -> None:
        if now < self._request_until or now < self._reply_until:
            seen.overlapping += 1
        elif now < self._reply_until + self._physics.silence_s:
            seen.early += 1

    def _answer(self, frame: bytes, now: float, seen: Seen) -> tuple[int, str, bytes]:
        address = self._framer.address(frame)
        module = None if address is None else self.modules.get(address)
        if address is None or module is None or address in self.dead:
            return -1 if address is None else address, "other", b""
        reply = self._answer_of(frame) or b""
        kind = _kind_of(frame, self._rtu)
        if kind == "write":
            self._replies.clear()
            seen.writes.append((now, self.index, address, module.outputs))
        else:
            self._replies[frame] = address, kind, reply
        return address, kind, reply

    def _answer_of(self, frame: bytes) -> bytes | None:
        module = self.modules[self._framer.address(frame) or 0]
        if self._rtu:
            return modbus.answer_rtu(module, frame)
        if frame.startswith(b"#"):
            return wisco.answer(module, frame)
        return modbus.answer_ascii(module, frame)


def _kind_of(frame: bytes, rtu: bool) -> str:
    if frame.startswith(b"#") and not rtu:
        command = frame[3:6]
        return {b"RDI": "inputs", b"RDO": "outputs", b"WDO": "write"}.get(command, "other")
    function = frame[1] if rtu else int(frame[3:5], 16)
    return {1: "outputs", 2: "inputs", 5: "write", 15: "write"}.get(function, "other")


class _Lines:
    """The loop of the process: what is due, what was written, what was ordered."""

    def __init__(self, orders: Connection, specs: tuple[LineSpec, ...]) -> None:
        self._orders = orders
        self._lines = [_Line(index, spec) for index, spec in enumerate(specs)]
        self._by_fileno = {line.endpoint.filenos()[0]: line for line in self._lines}
        self._due: list[tuple[float, int]] = []
        self._seen = Seen()
        self._chance = random.SystemRandom()
        self._running = True
        self._toggle_each_s = 0.0
        self._toggle_at = float("inf")
        self._to_toggle: list[tuple[int, int, int]] = []
        self._handlers: dict[str, Callable[..., Any]] = {
            "begin": self._begin,
            "take": lambda: self._seen,
            "toggle": self._toggle_from_now_on,
            "switch": self._switch,
            "kill": self._kill,
            "outputs": lambda line: {a: m.outputs for a, m in self._lines[line].modules.items()},
        }

    def run(self) -> None:
        """Works until it is told to stop."""
        self._orders.send([line.endpoint.port for line in self._lines])
        watched = [self._orders.fileno(), *self._by_fileno]
        while self._running:
            ready, _, _ = select.select(watched, [], [], self._nap_s())
            for fileno in ready:
                line = self._by_fileno.get(fileno)
                if line is None:
                    self._obey(*self._orders.recv())
                else:
                    self._hear(line, fileno)
            self._do_what_is_due()
        for line in self._lines:
            line.endpoint.close()

    def _nap_s(self) -> float | None:
        first = min(self._due[0][0] if self._due else float("inf"), self._toggle_at)
        if first == float("inf"):
            return None
        return max(0.0, first - time.monotonic() - _SPIN_S)

    def _hear(self, line: _Line, fileno: int) -> None:
        data = os.read(fileno, _READ_AT_MOST)
        now = time.monotonic()
        at = line.hear(data, now, self._seen)
        if at is None:
            return
        if at <= now:
            line.speak(fileno)
        else:
            heapq.heappush(self._due, (at, fileno))

    def _do_what_is_due(self) -> None:
        now = time.monotonic()
        while self._due and self._due[0][0] <= now:
            _, fileno = heapq.heappop(self._due)
            self._by_fileno[fileno].speak(fileno)
        if now >= self._toggle_at:
            self._toggle(now)

    # --- what is ordered ---

    def _obey(self, order: str, *arguments: Any) -> None:
        if order == "stop":
            self._running = False
        else:
            self._orders.send(self._handlers[order](*arguments))

    def _begin(self) -> None:
        self._seen = Seen()

    def _switch(self, line: int, address: int, output: int, on: bool) -> float:
        now = time.monotonic()
        self._lines[line].modules[address].set_output(output, on)
        self._lines[line].changed(now)
        return now

    def _kill(self, line: int, stations: frozenset[int]) -> float:
        self._lines[line].dead = stations
        self._lines[line].changed(now := time.monotonic())
        self._to_toggle.clear()
        return now

    def _toggle_from_now_on(self, each_s: float) -> None:
        self._toggle_each_s = each_s
        self._toggle_at = time.monotonic() + each_s if each_s else float("inf")

    def _toggle(self, now: float) -> None:
        if not self._to_toggle:
            # Every channel once before any comes again: a change is never overtaken by the next.
            self._to_toggle = [
                (line.index, address, channel)
                for line in self._lines
                for address in set(line.modules) - line.dead
                for channel in range(1, DIO100.inputs + 1)
            ]
            self._chance.shuffle(self._to_toggle)
        index, address, channel = self._to_toggle.pop()
        line = self._lines[index]
        module = line.modules[address]
        on = not module.inputs >> (channel - 1) & 1
        module.set_input(channel, on)
        line.changed(now)
        self._seen.toggles.append((now, index, address, channel, on))
        # At any phase of the round: an even beat could fall in with it.
        self._toggle_at = now + self._toggle_each_s * self._chance.uniform(0.5, 1.5)
