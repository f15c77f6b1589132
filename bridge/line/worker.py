"""The line worker: one thread that owns one line, its port and its stations.

Only this thread uses the bus, so there is no lock. Commands come in through a queue and are handled
between two exchanges; results leave as frozen events.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import closing

from bridge.bounded_log import Budgets
from bridge.config.schema import LineConfig, RuleConfig
from bridge.errors import PortError
from bridge.line.actions.automation import Automation
from bridge.line.actions.covers import Covers
from bridge.line.actions.duties import Duties
from bridge.line.actions.polling import Polling
from bridge.line.actions.read_backs import ReadBacks
from bridge.line.actions.stopping import LineStop
from bridge.line.actions.switching import OrderLostError, Switcher
from bridge.line.errand import ErrandEndedError, LineTask
from bridge.line.errands import Errands
from bridge.line.exchanger import Exchanger
from bridge.line.inbox import Item, TimeShare, WaitingCommands
from bridge.line.line_port import LinePort
from bridge.line.measured_bus import MeasuredBus
from bridge.line.plan.plan import Idle, PollPlan, WirePlan
from bridge.line.plan.streams import streams_of
from bridge.line.report import LineReport
from bridge.line.rules.frames import gaps_in, run_around
from bridge.line.rules.presence import UrgentProbes
from bridge.line.rules.strays import StrayWatch
from bridge.line.station import Station
from bridge.line.statistics import LineStatistics
from bridge.model import (
    AnyCommand,
    Command,
    CoverCommand,
    LeftCover,
    LineEvent,
    Orders,
    Reason,
    StandingCover,
    StandingCovers,
    Status,
    verdict_on,
)

_log = logging.getLogger(__name__)

_LONGEST_WAIT_S = 0.5  # so that the worker shows progress while nothing is due


class LineWorker:
    """Runs one line until it is stopped. The main thread calls `start` and `stop`.

    Attributes:
        progress: The worker's last sign of life (`bridge.clock.boot_s`), for the watchdog.
        failure: Why the thread died, or None.
        moving: The covers whose motor may run; after the end of the thread, those that it could not
            stop.
        standing: After the end of the thread, the covers that stand at a known position.
    """

    def __init__(
        self,
        config: LineConfig,
        emit: Callable[[LineEvent], None],
        open_bus: Callable[[LineConfig], Exchanger],
        clock: Callable[[], float],
        sleep: Callable[[float], None] = time.sleep,
        *,
        inbox: queue.SimpleQueue[Item] | None = None,
        budgets: Budgets | None = None,
    ) -> None:
        """Args: `inbox` is a virtual one in tests; `budgets` are those of the log."""
        self.config = config
        self.progress = clock()
        self.failure: str | None = None
        self.moving: tuple[LeftCover, ...] = ()
        self.standing: StandingCovers = ()
        self._emit = emit
        self._report = LineReport(config, emit, clock, budgets)
        self._open_bus = open_bus
        self._clock = clock
        self._strays = StrayWatch(self._report.strays, gateway="://" in config.port)
        stations = {
            station_config.address: Station(
                station_config, config, lambda: self._strays.is_contested(clock())
            )
            for station_config in config.stations
        }
        self._by_id = {station.config.id: station for station in stations.values()}
        presences = {address: station.presence for address, station in stations.items()}
        self._statistics = LineStatistics(config, presences, self.progress)
        self._plan: PollPlan = WirePlan(streams_of(config), presences)
        self._port = LinePort(config, stations.values(), self._report, clock)
        self._automation = Automation(self._by_id, self.submit, emit, clock)
        self._polling = Polling(
            stations,
            self._plan,
            self._report,
            self._statistics,
            self._automation,
            port_used=self._port.used,
            clock=clock,
        )
        self._commands = WaitingCommands(
            self._is_absolute,
            overtaken=lambda command: self._refuse(command, Reason.SUPERSEDED),
            may_stall=self._may_stall,
            in_one_frame=self._in_one_frame,
            follow_rules=self._automation.replace,
            inbox=inbox,
        )
        self._switcher = Switcher(self._plan, self._report, self._newer_waits, clock)
        self._read_backs = ReadBacks(self._switcher, emit, clock)
        self._duties = Duties(
            stations.values(), self._switcher, self._report, clock, unread=self._read_backs
        )
        self._covers = Covers(stations.values(), self._switcher, self._report, emit, clock)
        self._urgent_probes = UrgentProbes()
        self._stop = LineStop(
            stations,
            self._covers,
            polling=self._polling,
            report=self._report,
            clock=clock,
            sleep=sleep,
        )
        self._share = TimeShare(self.progress)
        self._errands = Errands(config.id, self._commands, self._serve_between, clock)
        self._thread = threading.Thread(target=self._run, name=f"line {config.id}", daemon=True)

    # --- called from the main thread ----------------------------------------------------------

    def inherit(self, left: Iterable[LeftCover], standing: Iterable[StandingCover] = ()) -> None:
        """Take over, before the start, the covers that an earlier line left moving or standing."""
        self._covers.inherit(left, standing)

    def start(self) -> None:
        """Start the thread; the port is opened there."""
        self._thread.start()

    def submit(self, command: AnyCommand) -> None:
        """Queue one command for a station of this line; its verdict comes as an event."""
        self._commands.put(command)

    def ask(self, task: LineTask) -> None:
        """Queue a request that is not a command."""
        self._commands.put(task)

    def broker(self, away_since: float | None, done: Orders = frozenset()) -> None:
        """Record since when the broker is away (None: present), and the orders done since then."""
        self._commands.broker(away_since, done)

    def rules(self, active: Iterable[RuleConfig]) -> None:
        """Follow these rules from now on: those of inputs of this line that are switched on."""
        self._commands.rules(tuple(active))

    def stop(self) -> None:
        """Ask the thread to end: it stops running motors first."""
        self._commands.stop(self._clock())

    def join(self, timeout_s: float) -> bool:
        """Wait for the end; return False if it did not come in time."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    @property
    def alive(self) -> bool:
        """Return whether the thread runs."""
        return self._thread.is_alive()

    # --- the thread ---------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self.work()
        except Exception as error:  # noqa: BLE001  # ends the thread, and says so
            self.failure = f"line {self.config.id}: {type(error).__name__}: {error}"
            _log.critical("%s", self.failure, exc_info=True, extra={"line": self.config.id})
            self._tell_left()

    def work(self) -> None:
        """Work until stopped: all that the thread does."""
        while not self._commands.stopping:
            self.progress = self._clock()
            try:
                with closing(self._opened()) as bus:
                    self._serve(bus)
            except PortError as error:
                if self._port.lost(error):
                    self._polling.lost()
                self._wait_closed()
        self._end()

    def _opened(self) -> MeasuredBus:
        bus = self._open_bus(self.config)
        self._port.opened()
        return MeasuredBus(bus, self._statistics, self._strays, self._clock, self._may_wait)

    def _may_wait(self) -> bool:
        """Return whether the bus may wait for replies; called before each exchange.

        It also notices a request to stop, because motors wait for that.
        """
        self.progress = self._clock()
        if self._covers:
            self.moving = self._covers.left
        self._refuse_late()  # a contact alone may take many exchanges
        return not self._commands.stopping or self._stop.has_begun

    def _begin_stop(self) -> None:
        """Begin the stop: from now on only motors count."""
        self._stop.begin(self._commands.stop_asked_at or self._clock())
        self._refuse_waiting(Reason.STOPPING)

    def _end(self) -> None:
        """Stop the motors after the port was closed: open it again while there is time."""
        self._begin_stop()
        while self._stop.goes_on:
            self.progress = self._clock()
            try:
                with closing(self._opened()) as bus:
                    self._stop.work(bus)
            except PortError:
                self._polling.lost()
                self._stop.port_lost()
        self._tell_left()
        self.standing = self._covers.standing
        self._commands.collect()
        self._refuse_waiting(Reason.STOPPING)
        self._errands.refuse("is being stopped")

    def _tell_left(self) -> None:
        self.moving = self._covers.left
        self._covers.tell_left()

    def _wait_closed(self) -> None:
        """Wait while the port is closed; commands that come in meanwhile are refused."""
        self._port.tick()
        self._refuse_waiting(Reason.OFFLINE)
        while not self._commands.stopping and (left := self._port.open_at - self._clock()) > 0:
            self._take_in(min(left, _LONGEST_WAIT_S))
            self._refuse_waiting(Reason.OFFLINE)
            if self._port.is_resting and (self._commands.asked_besides or self._overdue()):
                return
            self._errands.refuse("has no port: it is gone, or cannot be opened")
            self._show_progress()

    def _serve(self, bus: MeasuredBus) -> None:
        """Poll and carry out commands until the port is lost or the worker is stopped.

        Return without an error if the port is to be opened again.
        """
        self._errands.opened(bus)
        while True:
            self._collect(0.0)
            if self._commands.stopping:
                self._begin_stop()
                self._stop.work(bus)
                return
            if self._commands.asked_besides:
                self._errands.work(bus)
                continue
            if self._port.is_deaf():
                self._polling.ask_anew()
                return
            idle = self._serve_once(bus)
            if idle is not None:
                self._collect(min(idle.until, self._urgent_probes.next_at))

    def _serve_once(self, bus: Exchanger) -> Idle | None:
        """Make the writes that are due, then one read; return Idle if no read was due."""
        self._work_unasked(bus)
        if self._commands:
            self._carry_out_some(bus)
        if self._commands.stopping:
            return None
        due = self._plan.next(self._clock(), self._polling.waiting(bus))
        if isinstance(due, Idle):
            self._share.fill()  # no read is delayed
            bus.listen()
            return due
        if self._polling.has_to_wait(bus, due):
            self._collect(bus.quiet_until)
            if self._commands:
                self._carry_out_some(bus)
        if not self._commands.stopping:
            self._polling.poll(bus, due)
        return None

    def _serve_between(self, bus: MeasuredBus) -> bool:
        """Serve commands and polls once during an errand; return whether no read was due."""
        self._collect(0.0)
        if self._commands.stopping:
            raise ErrandEndedError(f"line {self.config.id} is being stopped")
        return self._serve_once(bus) is not None

    def _collect(self, until: float) -> None:
        """Take in commands; if there are none, wait until `until` for the first."""
        wait_s = 0.0 if self._commands else min(until - self._clock(), _LONGEST_WAIT_S)
        self._take_in(wait_s)
        self._show_progress()

    def _take_in(self, wait_s: float = 0.0) -> None:
        """Take in what the main thread sent; whether the broker is away is used at once."""
        if not self._commands.collect(wait_s):
            return
        self._duties.broker(self._commands.broker_away_since, self._commands.done_in_loss)
        self._automation.broker(self._commands.broker_away_since)

    def _show_progress(self) -> None:
        self.progress = self._clock()
        self._port.tick()
        self._tell_measures(self.progress)

    def _tell_measures(self, now: float) -> None:
        self._report.tick()
        if now >= self._statistics.due_at:
            for measured in self._statistics.report(now):
                self._emit(measured)

    # --- commands -----------------------------------------------------------------------------

    def _is_absolute(self, command: AnyCommand) -> bool:
        """Return whether it only sets outputs to values, and begins no pulse."""
        if not isinstance(command, Command):
            return False
        maybe_pulse = self._by_id[command.station_id].maybe_pulse
        return command.word is None and not command.values & maybe_pulse

    def _may_stall(self, command: AnyCommand) -> bool:
        name = command.station_id
        return self._by_id[name].presence.suspect is not None or self._read_backs.may_be_dead(name)

    def _in_one_frame(self, command: AnyCommand, outputs: int) -> int:
        """Return which of `outputs` one frame with `command` may write; 0: it goes alone."""
        station = self._by_id[command.station_id]
        if not isinstance(command, Command) or command.word is not None:
            return 0
        if command.mask & (station.known_pulse | station.interlock.grouped):
            return 0
        if not station.writer.protected:
            return outputs  # WDOX takes a mask
        return 0 if gaps_in(command.mask) else run_around(outputs, command.mask)

    def _newer_waits(self, command: AnyCommand) -> bool:
        return self._commands.newer_than(command)

    def _work_unasked(self, bus: Exchanger) -> None:
        """Do what is due without a command; motors first."""
        if not (self._covers or self._duties):
            return  # as on most lines
        self._covers.work(bus)
        self._duties.work(bus)
        due = {station.config.address: station.presence for station in self._overdue()}
        self._urgent_probes.work(due, self._clock())

    def _overdue(self) -> tuple[Station, ...]:
        """Return the modules for which something is overdue, first those with a motor to stop."""
        return (*self._covers.overdue(), *self._duties.overdue())

    def _carry_out_some(self, bus: Exchanger) -> None:
        """Make the writes that wait, then their read-backs; leave none to be read back."""
        now = self._clock()
        self._share.begin(now, urgent=self._commands.is_urgent(now))
        try:
            while self._carry_out_next(bus):
                self._polling.judge_silence()
                self._refuse_late()
                self._work_unasked(bus)
                self.progress = self._clock()
                self._take_in()
        except PortError as error:
            self._read_backs.lost(error)
            raise
        self._share.end(self._clock())

    def _carry_out_next(self, bus: Exchanger) -> bool:
        """Make one write or one read-back; False: there is none to make."""
        is_time = self._share.is_left(self._clock()) and not self._commands.stopping
        if not (self._commands and is_time):
            return self._read_backs.work()
        chosen = self._commands.choose()
        first = chosen[0]
        merges = self._in_one_frame(first, first.mask) != 0
        together = [one for one in chosen if isinstance(one, Command)] if merges else None
        stalls = self._may_stall(first)
        if self._read_backs.goes_first(together, first.station_id, stalls=stalls):
            return self._read_backs.work(first.station_id)
        self._commands.remove(chosen)
        refusal = self._refusal(self._by_id[first.station_id])
        if refusal is not None:
            for command in chosen:
                self._refuse(command, refusal)
        elif together is not None:
            self._read_backs.write(together, self._by_id[first.station_id], bus)
        else:
            self._carry_out_alone(first, self._by_id[first.station_id], bus)
        return True

    def _refusal(self, station: Station) -> Reason | None:
        if station.wrong_model:
            return Reason.WRONG_MODEL
        return None if station.presence.online else Reason.OFFLINE

    def _carry_out_alone(self, command: AnyCommand, station: Station, bus: Exchanger) -> None:
        """Write it, and read it back."""
        if isinstance(command, CoverCommand):
            self._covers.carry_out(command, bus)
            return
        self._covers.overruled(command.station_id, command.mask)
        try:
            if isinstance(command, Command):
                self._emit(self._switcher.switch(command, station, bus))
            else:
                self._emit(self._switcher.set(command, station, bus))
        except OrderLostError as lost:
            self._emit(lost.verdict)
            raise

    def _refuse_late(self) -> None:
        """Refuse expired commands in time, because each write may take 2 s.

        See docs/contract.md, promise 3.
        """
        self._take_in()
        if self._commands:
            for command in self._commands.take_late(self._clock()):
                self._refuse(command, Reason.EXPIRED)

    def _refuse_waiting(self, reason: Reason) -> None:
        self._covers.drop(reason)
        while self._commands:
            self._refuse(self._commands.pop(), reason)

    def _refuse(self, command: AnyCommand, reason: Reason) -> None:
        self._emit(verdict_on(command, self._clock(), Status.REFUSED, reason))
