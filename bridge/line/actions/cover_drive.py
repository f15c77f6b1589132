"""Carries out the commands to one cover, and ends its movements.

A reversal takes two writes with the dead time of the interlock between them; the line does other
work meanwhile. Each write follows the usual rules (`bridge.line.actions.writes`).
"""

from collections.abc import Callable
from dataclasses import replace

from bridge.config.schema import CoverConfig
from bridge.line.actions.switching import OrderLostError, Switcher
from bridge.line.exchanger import Exchanger
from bridge.line.report import LineReport
from bridge.line.rules.cover import CLOSED, OPEN, CoverMotion, Way
from bridge.line.rules.retry import Retry
from bridge.line.station import Station
from bridge.model import (
    AnyCommand,
    Command,
    CoverCommand,
    LeftCover,
    LineEvent,
    Reason,
    Status,
    Verdict,
    verdict_on,
)

_OFF_PATIENCE_S = 2.0
_NEAR = 0.5  # percent: a position this close counts as reached
_OFF_FIRST_PAUSE_S, _OFF_LONGEST_PAUSE_S = 0.25, 5.0


class CoverDrive:
    """One cover of one station. Only the thread of the line uses it."""

    def __init__(
        self,
        config: CoverConfig,
        motion: CoverMotion,
        station: Station,
        *,
        switcher: Switcher,
        report: LineReport,
        emit: Callable[[LineEvent], None],
        clock: Callable[[], float],
    ) -> None:
        self.config = config
        self._motion = motion
        self._station = station
        self._switcher = switcher
        self._report = report
        self._emit = emit
        self._clock = clock
        self._mask = motion.output(Way.OPENING) | motion.output(Way.CLOSING)
        self._waiting: CoverCommand | None = None  # it waits for the end of the dead time
        self._retry = Retry(_OFF_FIRST_PAUSE_S, _OFF_LONGEST_PAUSE_S)
        self._told_unasked = False

    # --- commands -----------------------------------------------------------------------------

    def carry_out(self, command: CoverCommand, bus: Exchanger) -> None:
        """Carry out a command, or begin to; its verdict follows when it is known."""
        self.drop(Reason.SUPERSEDED)
        self._begin(command, bus)

    def overruled(self, outputs: int) -> None:
        """Drop the waiting command if a newer command names one of our outputs."""
        if outputs & self._mask:
            self.drop(Reason.SUPERSEDED)

    def drop(self, reason: Reason) -> None:
        """Refuse the command that waits for the dead time."""
        command, self._waiting = self._waiting, None
        if command is not None:
            self._refuse(command, reason)

    def drop_late(self) -> None:
        """Refuse the waiting command if its deadline has passed."""
        if self._waiting is not None and self._clock() > self._waiting.deadline:
            self.drop(Reason.EXPIRED)

    # --- what falls due -----------------------------------------------------------------------

    def work(self, bus: Exchanger) -> bool:
        """Make the write that is due; return whether there was one. Raises PortError."""
        if not self._station.presence.online:
            self.drop(Reason.OFFLINE)
            return False
        self._tell_unasked()
        now = self._clock()
        if self._motion.is_over(now):
            return self._station.listens and self._retry.may_try(now) and self._end(bus)
        self._retry.reset()
        return self._waiting is not None and self._go_on(self._waiting, bus)

    @property
    def address(self) -> int:
        """Return the address of the station with its motor."""
        return self._station.config.address

    @property
    def running(self) -> int:
        """Return the outputs of its motor that may be ON, to be switched OFF when the line ends."""
        motion = self._motion
        if motion.way is None and not motion.both:
            return self._mask if motion.left else 0
        return sum(self._motion.output(way) for way in Way if self._runs(way))

    @property
    def left(self) -> LeftCover:
        """Return station and cover, for the next line."""
        return LeftCover(self.address, self._station.config.id, self.config.id)

    def tell_left(self) -> None:
        """Report that the motor may still run at the end of the line."""
        if self.running:
            self._report.cover_left(self._station, self.config.id)

    # --- the inside ---------------------------------------------------------------------------

    def _begin(self, command: CoverCommand, bus: Exchanger) -> None:
        try:
            self._go(command, bus)
        except OrderLostError as lost:
            self._tell(lost.verdict)
            raise

    def _go(self, command: CoverCommand, bus: Exchanger) -> None:
        way = self._way_to(command.goal)
        if isinstance(way, str):
            self._refuse(command, Reason.BUSY, way)
        elif way is None:
            self._tell(self._stop(command, bus))
        elif self._clock() + self._dead_s(way) > command.deadline:
            self._refuse(command, Reason.EXPIRED, "it would go out after the dead time")
        else:
            self._turn(command, way, bus)

    def _way_to(self, goal: int | None) -> Way | str | None:
        """Return the way to a goal; None: it stays; a text: why the way is not known."""
        if goal is None:
            return None
        if goal in {OPEN, CLOSED}:
            return Way(goal)
        here = self._motion.position(self._clock())
        if here is None:
            return "the position is not known: OPEN or CLOSE it first"
        if abs(goal - here) < _NEAR:
            return None
        return Way.OPENING if goal > here else Way.CLOSING

    def _dead_s(self, way: Way) -> float:
        """Return the rest of the dead time before this direction may go ON."""
        if self._runs(_other(way)):
            return self._station.config.interlock_dead_s
        return self._station.interlock.wait_s(self._motion.output(way), self._clock())

    def _turn(self, command: CoverCommand, way: Way, bus: Exchanger) -> None:
        """Switch the other direction OFF; this one follows, now or after the dead time."""
        if self._runs(_other(way)):
            verdict = self._write(command, self._motion.output(_other(way)), bus)
            if verdict.status is not Status.DONE:
                self._tell(verdict)
                return
            self._report.covers(self._station, self._clock())
        if self._dead_s(way) > 0:
            self._waiting = command
        else:
            self._start(command, way, bus)

    def _go_on(self, command: CoverCommand, bus: Exchanger) -> bool:
        """Continue the waiting command when the dead time is over."""
        way = self._way_to(command.goal)
        if isinstance(way, Way) and not self._runs(_other(way)) and self._dead_s(way) > 0:
            return False
        if self._switcher.newer_than(command):
            self.drop(Reason.SUPERSEDED)
            return False
        self._waiting = None
        self._begin(command, bus)
        return True

    def _start(self, command: CoverCommand, way: Way, bus: Exchanger) -> None:
        self._motion.aim(command.goal)
        verdict = self._write(command, self._motion.output(way), bus, on=True)
        if verdict.status is Status.DONE and verdict.seen_on is False:
            # Its mode was not read as latch. A pulse would be possible, but a motor has to keep
            # running.
            verdict = replace(verdict, status=Status.FAILED, reason=Reason.NOT_CONFIRMED)
        self._tell(verdict)

    def _stop(self, command: CoverCommand, bus: Exchanger) -> Verdict:
        """Switch one direction OFF; if the read after it finds the other one ON, also that one.

        Another master or a person may have switched it since the last read.
        """
        first = next((way for way in Way if self._runs(way)), Way.OPENING)
        verdict = self._write(command, self._motion.output(first), bus)
        if not self._runs(_other(first)):
            return verdict
        second = self._write(command, self._motion.output(_other(first)), bus)
        return second if verdict.status is Status.DONE else verdict

    def _end(self, bus: Exchanger) -> bool:
        """Switch OFF when the way is over or both are ON; repeat until the read shows it."""
        try:
            self._ended(self._switch_off(bus))
        except OrderLostError as lost:
            self._ended(lost.verdict)
            raise
        return True

    def _ended(self, verdict: Verdict) -> None:
        failing = self._retry.failing
        done = verdict.status is Status.DONE
        if done:
            self._retry.reset()
        else:
            self._retry.failed(self._clock())
        self._report.covers(self._station, self._clock())
        if failing is done:  # only the change is reported: it fails now, or works again
            why = "both directions were ON" if self._motion.both else "its way was over"
            detail = "; ".join(filter(None, (why, verdict.detail)))
            self._report.own_order(self._station, replace(verdict, by="covers", detail=detail))

    def _switch_off(self, bus: Exchanger) -> Verdict:
        now = self._clock()
        own = CoverCommand(
            station_id=self._station.config.id,
            target=f"cover/{self.config.id}",
            payload="OFF",
            cover=self.config.id,
            mask=self._mask,
            goal=None,
            arrived=now,
            deadline=now + _OFF_PATIENCE_S,
        )
        return self._stop(own, bus)

    def _write(
        self, command: CoverCommand, output: int, bus: Exchanger, *, on: bool = False
    ) -> Verdict:
        step = Command(
            station_id=command.station_id,
            target=command.target,
            payload=command.payload,
            mask=output,
            values=output if on else 0,
            word=None,
            arrived=command.arrived,
            deadline=command.deadline,
            id=command.id,
            reply_to=command.reply_to,
            by=command.by,
        )
        return self._switcher.switch(step, self._station, bus)

    def _runs(self, way: Way) -> bool:
        """Return whether it was ordered or read ON, and was not read OFF since."""
        read = self._station.outputs.value or 0
        return self._motion.way is way or bool(read & self._motion.output(way))

    def _tell_unasked(self) -> None:
        if self._motion.unasked and not self._told_unasked:
            self._report.cover_unasked(self._station, self.config.id, self._motion.longest_s)
        self._told_unasked = self._motion.unasked

    def _tell(self, verdict: Verdict) -> None:
        """Publish the new state, then the verdict (docs/topics.md, Verdicts)."""
        self._report.covers(self._station, self._clock())
        self._emit(verdict)

    def _refuse(self, command: AnyCommand, reason: Reason, detail: str | None = None) -> None:
        self._emit(verdict_on(command, self._clock(), Status.REFUSED, reason, detail=detail))


def _other(way: Way) -> Way:
    return Way.CLOSING if way is Way.OPENING else Way.OPENING
