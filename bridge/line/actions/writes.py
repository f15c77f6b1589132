"""Carries out one command on the wire, and returns its verdict.

The rules of docs/contract.md: a pulse is sent at most once. A latch write is repeated at most once,
and not if a newer command for that output waits. Nothing is sent after the deadline. `done` needs a
read after the write that agrees. Interlocked outputs are never ON together.
"""

from collections.abc import Callable

from bridge.errors import ExchangeError, ExpiredError, PortError, RefusedError
from bridge.line.actions.sending import READ_TRIES, Sending
from bridge.line.exchanger import Exchanger
from bridge.line.rules.frames import frames_for, gaps_in
from bridge.line.rules.interlock import named
from bridge.line.station import Station
from bridge.model import Command, Reason, Status, Verdict, Word, verdict_on

# Illegal function, address, value: it has no such registers (docs/protocol.md section 3).
_NEVER_TOLD = (1, 2, 3)
_UNREADABLE = "the modes of the module could not be read"


class Write:
    """One command in progress. Used once, by the thread of the line.

    Attributes:
        port_error: Set if the port was lost meanwhile.
    """

    def __init__(
        self,
        command: Command,
        station: Station,
        bus: Exchanger,
        clock: Callable[[], float],
        newer_waits: Callable[[], bool],
    ) -> None:
        self._command = command
        self._station = station
        self._bus = bus
        self._clock = clock
        self._newer_waits = newer_waits
        self._sending = Sending(station, bus, command.mask, command.deadline, clock)
        self._values = 0
        self._pulses = 0  # the outputs that are to go OFF by themselves
        self._modes_are_fresh = False
        self._frames = [command.mask]
        self._held_back: str | None = None  # why a repeat was not made
        self.port_error: PortError | None = None

    @property
    def started(self) -> int:
        """Return the outputs that were switched ON, as far as we know."""
        return self._sending.started

    @property
    def sent(self) -> bool:
        """Return whether a frame was sent, even a partial write."""
        return self._sending.sent

    def run(self) -> Verdict:
        """Carry out the command; return its verdict."""
        try:
            return self._carry_out()
        except PortError as error:
            self.port_error = error
            # It is not known how much of the frame was sent, so the verdict is "unknown".
            status = Status.UNKNOWN if self.sent else Status.FAILED
            return self._verdict(status, Reason.PORT_DOWN, detail=str(error))

    def _carry_out(self) -> Verdict:
        station, current = self._station, 0
        refusal = self._refusal_unread() or self._unread_modes()
        if refusal is not None:
            return refusal
        self._frames = self._chosen_frames()
        if self._needs_current():
            read = station.read_outputs(self._bus, READ_TRIES)
            if read is None:
                return self._verdict(Status.FAILED, Reason.NO_REPLY, detail="nothing was sent")
            current = read
            station.interlock.read(current, self._clock())
            running = self._running_between(current)
            if running is not None:
                return self._refused(Reason.BUSY, running)
        self._values = self._wanted(current)
        objection = self._interlocked(current)
        if objection is not None:
            return self._refused(Reason.INTERLOCK, objection)
        latches = station.latches_of(self._pulses)
        if latches:
            return self._refused(Reason.BAD_PAYLOAD, _stays_on(latches))
        return self._send(current)

    # --- before anything is sent --------------------------------------------------------------

    def _refusal_unread(self) -> Verdict | None:
        """Return the verdict of a command that is refused whatever the outputs are, or None."""
        command, station = self._command, self._station
        if self._is_late():
            return self._refused(Reason.EXPIRED)
        if command.word is Word.TOGGLE and command.mask & station.known_pulse:
            return self._refused(Reason.BAD_PAYLOAD, "a pulse output is not toggled: PRESS it")
        contradiction = station.interlock.contradiction(command.values)
        if contradiction is not None:
            return self._refused(Reason.INTERLOCK, contradiction)
        return None

    def _unread_modes(self) -> Verdict | None:
        """Read the modes if they matter (docs/failures.md F4); return a verdict if that fails."""
        station = self._station
        self._pulses = self._pulses_asked()
        over = self._gaps() != 0 and not self._gaps() & station.read_only
        if not station.tells_settings:
            return self._asked_again() if self._pulses else None
        if not (self._pulses or over):
            return None
        tries = READ_TRIES if self._pulses else 1  # else the write can be split at the gaps
        self._modes_are_fresh = station.read_settings(self._bus, tries)
        if self._modes_are_fresh or not self._pulses:
            return None
        reason = Reason.MODULE_REFUSED if station.refuses_settings else Reason.NO_REPLY
        return self._verdict(Status.FAILED, reason, detail=f"{_UNREADABLE}: nothing was sent")

    def _asked_again(self) -> Verdict | None:
        """Ask a module that refused to tell its modes when it was met: it may have been busy."""
        station = self._station
        if station.modbus is None or not station.takes_modbus:
            return None
        try:
            station.learn(self._bus.exchange(station.modbus.read_settings, protected=True))
        except RefusedError as error:
            if error.code in _NEVER_TOLD:
                return None
            reason = Reason.MODULE_REFUSED
        except ExchangeError:
            reason = Reason.NO_REPLY
        else:
            station.refuses_settings = False
            self._modes_are_fresh = True
            return None
        return self._verdict(Status.FAILED, reason, detail=f"{_UNREADABLE}: nothing was sent")

    def _pulses_asked(self) -> int:
        """Return the outputs that are to go OFF by themselves, as the sender could know."""
        if self._command.word is Word.PRESS:
            return self._command.mask
        station = self._station
        # One that is declared a pulse and latches would stay ON: its ON is refused as a PRESS is.
        return self._command.values & station.known_pulse if station.settings is not None else 0

    def _chosen_frames(self) -> list[int]:
        """Return the frames: WDOX takes a mask, a Modbus range would also write its gaps."""
        command, station = self._command, self._station
        if not station.writer.protected:
            return [command.mask]
        spared = station.read_only if self._modes_are_fresh else self._gaps()
        return frames_for(command.mask, command.values, spared)

    def _needs_current(self) -> bool:
        if self._command.word is Word.TOGGLE or self._written_over():
            return True
        return self._station.interlock.concerns(self._wanted(0))

    def _interlocked(self, current: int) -> str | None:
        """Return why the interlock forbids this write; `current` was read just now."""
        interlock, mask = self._station.interlock, self._command.mask
        if not interlock.concerns(self._values):
            return None
        return interlock.objection(mask, self._values, current, self._clock())

    def _gaps(self) -> int:
        """Return the gaps: outputs in the Modbus range that the command does not name."""
        return gaps_in(self._command.mask) if self._station.writer.protected else 0

    def _written_over(self) -> int:
        """Return the gaps that this write does write."""
        return self._gaps() if len(self._frames) == 1 else 0

    def _running_between(self, current: int) -> str | None:
        """Return why a range write has to wait; `current` was read just now."""
        running = self._written_over() & current & self._station.maybe_pulse
        return "an output between them holds a running pulse" if running else None

    def _wanted(self, current: int) -> int:
        command = self._command
        if command.word is Word.TOGGLE:
            return ~current & command.mask
        if command.word is Word.PRESS:
            return command.mask
        return command.values

    # --- on the wire --------------------------------------------------------------------------

    def _send(self, current: int) -> Verdict:
        if self._is_late():
            return self._refused(Reason.EXPIRED)
        try:
            self._sending.send(self._frames, self._values, current)
            seen = self._sending.look()
            if seen is not None and self._is_wanted_again(seen):
                seen = self._repeat(seen)
        except ExpiredError:
            return self._refused(Reason.EXPIRED)
        except RefusedError as error:
            self._sending.look()
            detail = "; ".join(filter(None, (str(error), self._left_out())))
            return self._verdict(
                Status.FAILED, Reason.MODULE_REFUSED, code=error.code, detail=detail
            )
        if seen is not None and self._ended_by_hand(seen):
            return self._verdict(
                Status.FAILED,
                Reason.NOT_CONFIRMED,
                detail=f"{_stays_on(self._pulses)}: switched OFF",
            )
        return self._judge(seen)

    def _is_wanted_again(self, seen: int) -> bool:
        """Return whether a latch with the wrong value may be written once more."""
        if self._command.mask & self._station.maybe_pulse or self._agrees(seen):
            return False
        return not self._is_late() and not self._newer_waits()

    def _repeat(self, seen: int) -> int | None:
        """Write once more if that is allowed; return the last read."""
        latest: int | None = seen
        if self._values & ~seen or self._written_over():
            self._held_back = self._forbidden_by_modes()
            if self._held_back is not None:
                return seen
            latest = self._sending.look()
            if latest is None or not self._is_wanted_again(latest):
                return latest
            seen = latest
        self._held_back = self._running_between(seen) or self._interlocked(seen)
        if self._held_back is not None:
            return seen
        try:
            self._sending.send(self._frames, self._values, seen)
        except ExpiredError:
            return seen
        return self._sending.look()

    def _forbidden_by_modes(self) -> str | None:
        """Return why nothing is repeated: a latch may have become a pulse, whose ON was sent."""
        if not self._station.read_settings(self._bus, READ_TRIES):
            return f"{_UNREADABLE}: it was not sent again"
        if self._command.mask & self._station.maybe_pulse:
            return "the module has an output in pulse mode by now: it was not sent again"
        return None

    def _is_late(self) -> bool:
        """Return whether a frame would be sent after the deadline, with the wait of the bus."""
        free_at = self._bus.free_at(self._station.config.address)
        return max(self._clock(), free_at) > self._command.deadline

    def _ended_by_hand(self, seen: int) -> bool:
        """Switch an output OFF that was a pulse when it was sent, and is a latch now.

        It ends what the command began, so the deadline does not apply.
        """
        station, pulses = self._station, self._pulses & self.started & seen
        if not pulses or not station.tells_settings:
            return False
        if not station.read_settings(self._bus, READ_TRIES):
            return False
        self._pulses = station.latches_of(pulses)
        if self._pulses:
            self._sending.switch_off(self._pulses)
        return self._pulses != 0

    # --- what became of it --------------------------------------------------------------------

    def _agrees(self, seen: int) -> bool:
        return (seen ^ self._values) & self._command.mask == 0

    def _judge(self, seen: int | None) -> Verdict:
        detail = self._held_back or self._left_out()
        if seen is None:
            return self._verdict(Status.UNKNOWN, Reason.NO_REPLY, detail=detail)
        mask, maybe_pulse = self._command.mask, self._station.maybe_pulse
        if not mask & maybe_pulse:
            if self._agrees(seen):
                return self._verdict(Status.DONE)
            return self._verdict(Status.FAILED, Reason.NOT_CONFIRMED, detail=detail)
        seen_on = self._seen_on(seen)
        if self._sending.unanswered:
            return self._verdict(Status.UNKNOWN, Reason.NO_REPLY, seen_on=seen_on, detail=detail)
        # A pulse may end before the read, so it need not be read ON.
        demanded = mask & ~(maybe_pulse & self.started)
        if (seen ^ self._values) & demanded:
            return self._verdict(
                Status.FAILED, Reason.NOT_CONFIRMED, seen_on=seen_on, detail=detail
            )
        return self._verdict(Status.DONE, seen_on=seen_on)

    def _seen_on(self, seen: int) -> bool | None:
        """Return whether every pulse that was started still reads ON; None: none was started."""
        started = self._station.maybe_pulse & self.started
        return seen & started == started if started else None

    def _left_out(self) -> str | None:
        """Return the outputs in frames that were never sent, in words."""
        if not self._sending.unsent or not self.sent:
            return None
        return f"not sent to {named(self._sending.unsent)}"

    def _refused(self, reason: Reason, detail: str | None = None) -> Verdict:
        return self._verdict(Status.REFUSED, reason, detail=detail)

    def _verdict(
        self,
        status: Status,
        reason: Reason | None = None,
        *,
        code: int | None = None,
        seen_on: bool | None = None,
        detail: str | None = None,
    ) -> Verdict:
        return verdict_on(
            self._command,
            self._clock(),
            status,
            reason,
            code=code,
            seen_on=seen_on,
            detail=detail,
        )


def _stays_on(outputs: int) -> str:
    return f"the module has {named(outputs)} in latch mode, where it would stay ON"
