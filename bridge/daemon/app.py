"""Starts what `wiring` builds, watches over it, stops it.

One main thread owns hub, publisher and session; line workers and the MQTT client have a thread
each and reach the main thread through one queue.
"""

import logging
import math
import queue
import time
from collections.abc import Callable
from enum import Enum
from pathlib import Path

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.clock import SuspendWatch, boot_s
from bridge.config.schema import Config
from bridge.daemon.panel import make_panel, start_panel
from bridge.daemon.systemd import Notifier
from bridge.daemon.wiring import OpenPort, Outside, build_tree, open_bus, wall_clock
from bridge.hub.cover_file import keep_covers, take_covers
from bridge.hub.memory import Memory
from bridge.line.errand import ErrandTold
from bridge.line.rules.halt import BUDGET_S
from bridge.line.worker import LineWorker
from bridge.model import LineEvent, LinePassed, MainWork
from bridge.mqtt.backlog import EventQueue
from bridge.mqtt.client import MqttClient
from bridge.mqtt.events import MqttEvent, OutMessage
from bridge.mqtt.log_handler import MOST_WAITING, BridgeLogHandler, LogLine
from bridge.mqtt.payloads import OFFLINE
from bridge.mqtt.plain import plain_subscriptions
from bridge.mqtt.topics import Topics
from bridge.transport.opener import open_port

_log = logging.getLogger(__name__)

_TICK_S = 0.1
_EVENTS_A_ROUND = 200  # then a tick, so that a flood of events does not delay pings
# Longer than any single action of a healthy thread: a contact on the slowest line, a connect to a
# broker that does not answer.
_STUCK_AFTER_S = 25.0
_LINES_STOP_S = 0.8
# At most: a running motor is switched OFF, and the exchange in progress may be slow.
_COVERS_STOP_S = BUDGET_S + 2.0
_BROKER_STOP_S = 0.8
_DISK_STOP_S = 1.0
_PANEL_STOP_S = 3.0  # at most: an output that blinks is switched OFF
# The longest time of a clean stop; systemd's TimeoutStopSec is longer.
LONGEST_STOP_S = _COVERS_STOP_S + 1.5 * _BROKER_STOP_S + 2 * _DISK_STOP_S + _PANEL_STOP_S


_Event = LineEvent | LinePassed | ErrandTold | MqttEvent | MainWork


class Wanted(Enum):
    """Describe what a signal asks for."""

    STOP = "stop"
    RELOAD = "reload"


class RunResult(Enum):
    """Describe why a run ended. `RESTART`: the configuration needs a new `App`."""

    STOPPED = "stopped"
    RESTART = "restart"
    FAILED = "failed"


class App:
    """One run of the bridge at one broker. Used once, by the main thread.

    `load` reads the configuration again; it raises ConfigError or LockHeldError. None: there is no
    reload. `memory` comes from the run before this one, at another broker. `open_port` opens the
    ports of the lines.
    """

    def __init__(
        self,
        config: Config,
        notifier: Notifier,
        load: Callable[[], Config] | None = None,
        memory: Memory | None = None,
        *,
        open_port: OpenPort = open_port,
        budgets: Budgets | None = None,
        config_path: Path | None = None,
    ) -> None:
        """Create it; `budgets` limit the log over all runs of this process.

        `config_path` is the file that the panel shows and saves; None: it has none.
        """
        self._memory = memory = memory or Memory()
        self._notifier = notifier
        self._clock = boot_s
        budgets = Budgets(self._clock) if budgets is None else budgets
        self._events: EventQueue[_Event] = EventQueue()
        log_lines: queue.Queue[LogLine] = queue.Queue(MOST_WAITING)
        self._log_handler = BridgeLogHandler(log_lines)
        self._watchdog_at = 0.0
        self._repeats = BoundedLog(_log, self._clock, budgets)
        self._suspends = SuspendWatch(self._clock(), time.monotonic())
        self._awake_since = -math.inf
        topics = Topics(config.mqtt.base_topic)
        self._client = MqttClient(
            config.mqtt,
            topics.subscriptions(config.homeassistant.status_topic),
            self._events.put,
            will=OutMessage(topics.bridge_state, OFFLINE, qos=1, retain=True),
            backlog=self._events.backlog,
            plain=lambda: plain_subscriptions(self.config, topics, self._tree.broker.desk.verbs),
            budgets=budgets,
        )
        outside = Outside(
            self._client, self._clock, wall_clock, log_lines=log_lines, budgets=budgets
        )
        self._panel = make_panel(config, self._events.put, config_path, budgets)
        self._tree = build_tree(
            config,
            outside,
            lambda line: LineWorker(
                line,
                self._events.put,
                lambda line: open_bus(line, open_port),
                self._clock,
                budgets=budgets,
            ),
            self._events.put,
            load=load,
            memory=memory,
            notifier=notifier,
            listen=None if self._panel is None else self._panel.hear,
        )

    @property
    def config(self) -> Config:
        """Return the configuration in force; after `RESTART` the one to start anew with."""
        return self._tree.reload.anew or self._tree.current.config

    def run(self, poll_signals: Callable[[], Wanted | None]) -> RunResult:
        """Run until `poll_signals` returns an outcome or a thread fails.

        At `RELOAD` it reads the configuration again, and ends only for another broker. At its end
        it publishes `offline`, whatever the reason. A stop with a motor that still runs is a
        failure.
        """
        logging.getLogger().addHandler(self._log_handler)
        try:
            self._tree.count_keeper.open(self._clock())
            self._tree.rule_keeper.open()
            memory, path = self._memory, self.config.state_file("covers")
            standing = memory.standing_covers or take_covers(path, self._clock(), self._repeats)
            self._tree.lines.start(self.config.lines, memory.left_covers, standing)
            self._tree.hub.rules.tell_all()
            self._client.start()
            start_panel(self._panel, self._tree)
            self._notifier.ready(f"{len(self._tree.lines.workers)} lines")
            outcome = self._work(poll_signals)
            if outcome is not RunResult.RESTART:  # systemd knows of a reload already
                self._notifier.stopping()
        finally:
            motors_stand = self._shut_down()
            logging.getLogger().removeHandler(self._log_handler)
        if outcome is not RunResult.RESTART:  # the next run has it in its memory
            path, standing = self.config.state_file("covers"), self._memory.standing_covers
            keep_covers(path, standing, self._clock(), _DISK_STOP_S, self._repeats)
        if outcome is RunResult.STOPPED and not motors_stand:
            return RunResult.FAILED
        return outcome

    # --- while it runs ------------------------------------------------------------------------

    def _work(self, poll_signals: Callable[[], Wanted | None]) -> RunResult:
        while True:
            self._handle_events(_TICK_S)
            wanted = poll_signals()
            if wanted is Wanted.STOP:
                return RunResult.STOPPED
            if wanted is Wanted.RELOAD:
                self._tree.reload.ask()
            now = self._clock()
            self._notice_suspend(now)
            self._tree.lines.broker(away=self._tree.broker.session.is_away(now), now=now)
            self._tree.count_keeper.tick(now)
            self._tree.rule_keeper.tick(now)
            if self._panel is not None:
                self._panel.tick(now)
            self._tree.reload.tick(self._drain)
            if self._tree.reload.anew is not None:
                return RunResult.RESTART
            failure = self._failure(now)
            if failure is not None:
                _log.critical("%s: the bridge ends, to be started anew", failure)
                return RunResult.FAILED
            self._feed_watchdog()

    def _handle_events(self, wait_s: float) -> None:
        """Handle what the threads reported, after a wait for the first; then send what is due."""
        try:
            event = self._events.get(timeout=wait_s)
            for _ in range(_EVENTS_A_ROUND):
                self._handle(event)
                event = self._events.get_nowait()
            self._handle(event)
        except queue.Empty:
            pass
        self._tree.traces.tick(self._clock())
        self._tree.broker.session.tick(self._clock())

    def _drain(self) -> None:
        """Handle everything that was reported up to now."""
        for _ in range(self._events.qsize()):
            self._handle(self._events.get_nowait())

    def _handle(self, event: _Event) -> None:
        if isinstance(event, MqttEvent):
            self._tree.broker.session.handle(event, self._clock())
        elif isinstance(event, LinePassed):
            self._tree.traces.passed(event)
        elif isinstance(event, ErrandTold):
            self._tree.errands.told(event)
        elif isinstance(event, MainWork):
            event.do()
        else:
            self._tree.hub.apply(event)

    def _failure(self, now: float) -> str | None:
        """Return a thread that died or is stuck, by name (docs/contract.md, promise 10)."""
        # After a suspend every sign of life is old: each thread gets its time again.
        slept = now - self._awake_since < _STUCK_AFTER_S
        stuck_before = -math.inf if slept else now - _STUCK_AFTER_S
        line_failure = self._tree.lines.failure(stuck_before)
        if line_failure is not None:
            return line_failure
        if not self._client.alive():
            return f"the MQTT thread died: {self._client.failure}"
        if self._client.progress < stuck_before:
            return "the MQTT thread is stuck"
        return None if self._panel is None else self._panel.failure(stuck_before)

    def _notice_suspend(self, now: float) -> None:
        slept_s = self._suspends.slept_s(now, time.monotonic())
        if slept_s > 0:
            self._awake_since = now
            self._tree.broker.session.suspended(slept_s, now)
        self._repeats.tick()

    def _feed_watchdog(self) -> None:
        """Feed the watchdog, only after every thread was found healthy."""
        interval_s = self._notifier.watchdog_interval_s
        now = self._clock()
        if interval_s is not None and now >= self._watchdog_at:
            self._notifier.watchdog()
            self._watchdog_at = now + interval_s

    # --- the end ------------------------------------------------------------------------------

    def _shut_down(self) -> bool:
        """End everything; return whether every motor was read OFF."""
        self._tree.broker.session.stopping()
        if self._panel is not None:
            self._panel.stopping()
        self._tree.lines.stop()
        until = self._clock() + self._lines_stop_s()
        while self._clock() < until and not self._tree.lines.all_left:
            self._handle_events(0.01)
        self._handle_events(0)  # the last verdicts and edges
        motors_stand = self._no_motor_runs()
        self._memory.left_covers = self._tree.lines.left_covers
        self._memory.standing_covers = self._tree.lines.standing_covers
        self._tree.broker.session.stop(self._clock())
        until = self._clock() + _BROKER_STOP_S
        while self._clock() < until and not self._tree.broker.session.drained:
            self._handle_events(0.01)
        self._client.stop(_BROKER_STOP_S / 2)
        if self._panel is not None:
            self._panel.stop()
        self._tree.count_keeper.close(_DISK_STOP_S)
        self._tree.rule_keeper.close(_DISK_STOP_S)
        return motors_stand

    def _no_motor_runs(self) -> bool:
        """Return whether no motor was left running; log those of lines that did not end.

        A line that ended has logged its own.
        """
        unended = self._tree.lines.moving(alive=True)
        for cover in unended:
            text = f"{cover} may still move: its line did not end in time"
            self._repeats.tell(Cause.MOTOR, cover, logging.ERROR, text)
        return not unended and not self._tree.lines.moving(alive=False)

    def _lines_stop_s(self) -> float:
        """Return the time that the lines have to end; only a silent module needs all of it."""
        covers = any(config.covers for line in self._tree.lines.leaving for config in line.stations)
        return _COVERS_STOP_S if covers else _LINES_STOP_S
