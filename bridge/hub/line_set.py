"""The line workers of a configuration, and their replacement at a reload."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

from bridge.config.schema import LineConfig, RuleConfig
from bridge.hub.memory import Loss
from bridge.line.errand import LineTask
from bridge.model import AnyCommand, LeftCover, Orders, StandingCover, StandingCovers


class Worker(Protocol):
    """The interface of a line worker for a line set (`bridge.line.worker`)."""

    config: LineConfig
    progress: float
    failure: str | None
    moving: tuple[LeftCover, ...]  # covers whose motor may run
    standing: StandingCovers  # where covers stand, after its end

    @property
    def alive(self) -> bool:
        """Return whether its thread runs."""

    def inherit(self, left: Iterable[LeftCover], standing: Iterable[StandingCover] = ()) -> None:
        """Take over, before the start, covers that earlier lines left moving or standing."""

    def start(self) -> None:
        """Start the thread."""

    def submit(self, command: AnyCommand) -> None:
        """Queue one command; its verdict comes back as an event."""

    def ask(self, task: LineTask) -> None:
        """Queue a request that is not a command."""

    def broker(self, away_since: float | None, done: Orders = frozenset()) -> None:
        """Record since when the broker is away (None: present), and the orders done since then."""

    def rules(self, active: Iterable[RuleConfig]) -> None:
        """Follow these rules from now on: those of inputs of its line that are switched on."""

    def stop(self) -> None:
        """Ask the thread to end."""


class LineSet:
    """Starts, watches and stops line workers. Only the main thread calls it.

    Attributes:
        workers: Those that take commands, by the id of their line. A line that is just being
            replaced is not among them.
    """

    def __init__(self, make: Callable[[LineConfig], Worker], loss: Loss | None = None) -> None:
        self.workers: dict[str, Worker] = {}
        self._make = make
        self._leaving: list[Worker] = []
        self._coming: list[LineConfig] = []
        self._loss = loss or Loss()

    def start(
        self,
        lines: Iterable[LineConfig],
        left: Sequence[LeftCover] = (),
        standing: Sequence[StandingCover] = (),
    ) -> None:
        """Start a worker for each line; it takes over its covers of `left` and `standing`."""
        for line in lines:
            worker = self.workers[line.id] = self._make(line)
            worker.broker(self._loss.since, self._loss.done)
            worker.inherit(left, standing)
            worker.start()

    def stop(self) -> None:
        """Ask every worker to end."""
        self._leave(self.workers)

    def broker(self, *, away: bool, now: float) -> None:
        """Tell every worker whether the broker is away, and since when."""
        if self._loss.turn(away=away, now=now):
            for worker in self.workers.values():
                worker.broker(self._loss.since)

    # --- another configuration ------------------------------------------------------------------

    def replace(self, lines: Iterable[LineConfig]) -> None:
        """Ask the lines to end that differ in `lines`; `renew` starts the new ones.

        An old worker has to end before the new one starts, because they may share a port.
        """
        wanted = {line.id: line for line in lines}
        self._leave({i: w for i, w in self.workers.items() if wanted.get(i) != w.config})
        self._coming = [line for line in wanted.values() if line.id not in self.workers]

    def renew(self) -> None:
        """Start what `replace` left to be started, when `all_left`."""
        left, standing = self.left_covers, self.standing_covers
        self._leaving.clear()
        coming, self._coming = self._coming, []
        self.start(coming, left, standing)

    @property
    def left_covers(self) -> tuple[LeftCover, ...]:
        """Return the covers whose motor may run, on lines that were asked to end."""
        return tuple(cover for worker in self._leaving for cover in worker.moving)

    @property
    def standing_covers(self) -> StandingCovers:
        """Return where covers stand, on lines that have ended."""
        return tuple(cover for worker in self._leaving for cover in worker.standing)

    @property
    def leaving(self) -> list[LineConfig]:
        """Return what `replace` took out."""
        return [worker.config for worker in self._leaving]

    @property
    def coming(self) -> list[LineConfig]:
        """Return the lines that `renew` will start."""
        return list(self._coming)

    @property
    def all_left(self) -> bool:
        """Return whether all lines that were asked to end have ended and reported everything."""
        return not any(worker.alive for worker in self._leaving)

    def moving(self, *, alive: bool) -> list[str]:
        """Return the covers that may move on lines that were asked to end.

        `alive` selects the lines that have not ended yet, or (False) those that have.
        """
        return [
            f"line {worker.config.id} {cover}"
            for worker in self._leaving
            if worker.alive is alive
            for cover in worker.moving
        ]

    # --- how they are ---------------------------------------------------------------------------

    def failure(self, stuck_before: float) -> str | None:
        """Return the name of a thread that died, or gave no sign of life since that instant.

        See docs/contract.md, promise 10.
        """
        for worker in self.workers.values():
            if not worker.alive:
                return worker.failure or f"the thread of line {worker.config.id} ended"
        for worker in (*self.workers.values(), *self._leaving):
            if worker.alive and worker.progress < stuck_before:
                return f"the thread of line {worker.config.id} is stuck"
        return None

    def _leave(self, workers: Mapping[str, Worker]) -> None:
        for line, worker in list(workers.items()):
            worker.stop()
            self._leaving.append(worker)
            del self.workers[line]
