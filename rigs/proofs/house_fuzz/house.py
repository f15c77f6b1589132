"""The house: the real program with its threads on the clockwork, its lines and its broker."""

import logging
import queue
import random
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import bridge.daemon.app
import bridge.daemon.wiring
import bridge.hub.file_writer
import bridge.hub.rule_keeper
import bridge.line.inbox
import bridge.line.worker
from bridge.bounded_log import Budgets
from bridge.config.schema import Config, LineConfig
from bridge.daemon.app import App, RunResult, Wanted
from bridge.daemon.systemd import Notifier
from bridge.errors import ConfigError, Problem
from bridge.hub.cover_file import BELIEVED_S
from bridge.hub.memory import Memory
from bridge.model import StandingCovers
from bridge.simulator.module import SimulatedModule
from proofs.house_fuzz.broker import Broker, Client
from proofs.house_fuzz.clockwork import Clockwork, Queue, Thread
from proofs.house_fuzz.line import ByteLine, FastLine, Line
from proofs.house_fuzz.oracle import Oracle
from proofs.house_fuzz.plan import draw_config

_EPOCH = datetime(2026, 1, 1, tzinfo=UTC)


class House:
    """One house, and the bridge in it.

    Attributes:
        file: What the configuration file says now; None: nonsense.
        disk: The files that the bridge wrote.
        outcome: What the last run of the bridge came to; None while it runs.
    """

    def __init__(
        self, way: str, seed: int, config: Config | None = None, *, by_bytes: bool | None = None
    ) -> None:
        """Args: `config` is a drawn one without it; `by_bytes`: the real bus; None: it is drawn."""
        self.chance = random.Random(seed)  # noqa: S311  # a house, not secrets
        self.clockwork = Clockwork()
        self.broker = Broker(self.clockwork, self.chance)
        self.file: Config | None = config or draw_config(way, self.chance)
        self.disk: dict[Path, bytes] = {}
        self._standing: tuple[StandingCovers, float] = ((), 0.0)  # covers, at the last stop
        self.config = self.file
        self.oracle = Oracle(self.config, self.broker, self.clockwork)
        self.broker.watcher = self.oracle
        if by_bytes is None:
            by_bytes = self.chance.random() < 0.15
        kind = ByteLine if by_bytes else FastLine
        self.lines: dict[str, Line] = {}
        for each in self.config.lines:
            sent = partial(self.oracle.sent, each.id)
            line = self.lines[each.port] = kind(self.clockwork, each, self.chance, sent)
            line.trouble = partial(self.oracle.trouble, each.id)
            self._furnish(line, each, wisco_only=way == "wisco-only")
        self.oracle.lines = {each.id: self.lines[each.port] for each in self.config.lines}
        self.outcome: RunResult | None = None
        self._asked: Wanted | None = None
        self._thread: Thread | None = None

    def _furnish(self, line: Line, config: LineConfig, *, wisco_only: bool) -> None:
        for station_config in config.stations:
            module = line.modules[station_config.address] = SimulatedModule(
                station_config.model,
                station_config.address,
                wisco_only=wisco_only,
                clock=self.clockwork.boot_s,
                listener=partial(self.oracle.switched, config.id),
            )
            for output in station_config.outputs:
                drawn_s = self.chance.choice((0.1, 0.3, 0.5, 1.0, 2.0))
                hold_s = output.hold_s or drawn_s
                module.set_mode(output.channel, pulse=output.mode == "pulse", hold_s=hold_s)
            self.oracle.meet(config.id, station_config, module)

    # --- the bridge ---------------------------------------------------------------------------

    @property
    def runs(self) -> bool:
        """Tell whether the process is there."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> None:
        """Start the process."""
        assert not self.runs
        self.outcome = self._asked = None
        self.oracle.began()
        self._thread = Thread(self.clockwork, self._main, "main")
        self._thread.start()

    def ask(self, wanted: Wanted) -> None:
        """Send SIGTERM or SIGHUP."""
        if self._asked is not Wanted.STOP:
            self._asked = wanted

    def stop(self) -> None:
        """Send SIGTERM, and wait for the end."""
        self.oracle.stopping()
        self.ask(Wanted.STOP)
        until = self.clockwork.now + 60.0
        while self.runs and self.clockwork.now < until:
            self.clockwork.wait(0.2)
            self.oracle.trouble_all()
        self.oracle.gone()
        assert not self.runs, "it does not end"

    def load(self) -> Config:
        """Read the file."""
        if self.file is None:
            raise ConfigError([Problem("house", 1, 1, "nonsense")])
        self.oracle.loaded(self.file)
        return self.file

    def _poll(self) -> Wanted | None:
        asked, self._asked = self._asked, None
        return asked

    def _main(self) -> None:
        """What `wisco2mqtt run` does."""
        assert self.file is not None
        config, memory = self.file, Memory()
        self.oracle.rules.loaded(config.rules)
        budgets = Budgets(self.clockwork.boot_s)
        while True:
            app = App(config, Notifier({}), self.load, memory, budgets=budgets)
            self.outcome = app.run(self._poll)
            if self.outcome is not RunResult.RESTART:
                break
            config = app.config
            self.oracle.began(reload=True)
        self.oracle.ended(self.outcome)

    # --- the clock ----------------------------------------------------------------------------

    def settle(self, seconds: float) -> None:
        """Let time pass."""
        self.clockwork.wait(seconds)

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Put clock, threads, ports and broker in the place of the real ones."""
        clockwork = self.clockwork
        queues = SimpleNamespace(
            Queue=partial(Queue, clockwork),
            SimpleQueue=partial(Queue, clockwork),
            Empty=queue.Empty,
            Full=queue.Full,
        )
        threads = SimpleNamespace(Thread=self._make_thread)
        clock = SimpleNamespace(monotonic=clockwork.monotonic)
        with ExitStack() as stack:
            put: Any = lambda *where, **what: stack.enter_context(patch.object(*where, **what))  # noqa: E731
            put(bridge.daemon.app, "queue", queues)
            put(bridge.daemon.app, "EventQueue", partial(Queue, clockwork))
            put(bridge.daemon.app, "time", clock)
            put(bridge.daemon.app, "boot_s", clockwork.boot_s)
            put(bridge.daemon.app, "open_bus", self._open)
            put(bridge.daemon.app, "MqttClient", partial(_client, self.broker))
            put(bridge.daemon.app, "wall_clock", self._wall_clock)
            put(bridge.daemon.app, "keep_covers", self._keep_covers)
            put(bridge.daemon.app, "take_covers", self._take_covers)
            put(bridge.daemon.wiring, "random", self.chance)
            put(bridge.hub.file_writer, "threading", SimpleNamespace(Thread=_AtOnce))
            put(bridge.hub.rule_keeper, "replace_file", self.disk.__setitem__)
            put(bridge.hub.rule_keeper, "read_file", self._read_file)
            put(bridge.line.inbox, "queue", queues)
            put(bridge.line.worker, "threading", threads)
            if hasattr(bridge.line.worker, "time"):
                defaults = bridge.line.worker.LineWorker.__init__.__defaults__
                put(
                    bridge.line.worker.LineWorker.__init__,
                    "__defaults__",
                    tuple(clockwork.wait if one is _REAL_SLEEP else one for one in defaults or ()),
                )
            stack.enter_context(_listening(self.oracle.logged))
            yield

    def _open(self, config: LineConfig, *_: object) -> object:
        return self.lines[config.port].open(config)

    def _read_file(self, path: Path, _limit: int) -> bytes:
        if path not in self.disk:
            raise FileNotFoundError
        return self.disk[path]

    def _keep_covers(self, _path: Path, standing: StandingCovers, now: float, *_: object) -> None:
        self._standing = standing, now

    def _take_covers(self, _path: Path, now: float, _log: object) -> StandingCovers:
        (standing, at), self._standing = self._standing, ((), 0.0)
        return standing if now - at <= BELIEVED_S else ()

    def _make_thread(self, target: Any, name: str, daemon: bool) -> Thread:
        assert daemon
        return Thread(self.clockwork, target, name)

    def _wall_clock(self) -> datetime:
        return _EPOCH + timedelta(seconds=self.clockwork.now)


_REAL_SLEEP = time.sleep


class _AtOnce:
    """Stands in for the short thread of a write to the disk."""

    def __init__(self, target: Any, args: Any, **_: Any) -> None:
        self.start = partial(target, *args)

    def is_alive(self) -> bool:
        """It was done at once."""
        return False

    def join(self, _timeout: float) -> None:
        """There is nothing to wait for."""


def _client(
    broker: Broker, config: Any, subscriptions: Any, emit: Any, will: Any, **_: Any
) -> Client:
    return Client(broker, config, subscriptions, emit, will)


class _LogTap(logging.Handler):
    def __init__(self, take: Any) -> None:
        super().__init__(logging.WARNING)
        self.emit = take  # type: ignore[method-assign]


@contextmanager
def _listening(take: Any) -> Iterator[None]:
    root, tap = logging.getLogger(), _LogTap(take)
    level = root.level
    root.addHandler(tap)
    root.setLevel(logging.WARNING)
    yield
    root.removeHandler(tap)
    root.setLevel(level)
