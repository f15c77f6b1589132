"""Carries out commands in one write on the wire, and says what became of each.

The rules of docs/contract.md: a pulse is sent at most once. A latch write is repeated at most once,
and not if a newer command for that output waits. Nothing is sent after the deadline. `done` needs a
read after the write that agrees. Interlocked outputs are never ON together.
"""

from collections.abc import Callable, Iterable, Sequence

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
    """One write on its way. Used once, by the thread of the line.

    As a rule it carries one command. Several are merged only where none of them is a TOGGLE, a
    PRESS, for a known pulse or interlocked, and no two name the same output.

    Attributes:
        mask: The outputs that it names.
        judged: The commands that have their verdict.
        port_error: Set by `run` if the port went away meanwhile.
    """

    def __init__(
        self,
        commands: Sequence[Command],
        station: Station,
        bus: Exchanger,
        clock: Callable[[], float],
        newer_waits: Callable[[Command], bool],
    ) -> None:
        self.judged: list[tuple[Command, Verdict]] = []
        self.port_error: PortError | None = None
        self.mask = sum(command.mask for command in commands)
        self._commands = tuple(commands)  # those without a verdict
        self._word = commands[0].word
        self._station = station
        self._bus = bus
        self._clock = clock
        self._newer_waits = newer_waits
        self._sending = Sending(station, bus, self.mask, clock)
        self._values = 0
        self._pulses = 0  # the outputs that are to go OFF by themselves
        self._modes_are_fresh = False
        self._frames = [self.mask]
        self._refusal: RefusedError | None = None
        self._refused_of: Sequence[Command] = ()  # whose frame the module refused
        self._held_back: str | None = None  # why a repeat was not made

    @property
    def started(self) -> int:
        """Return the outputs that were switched ON, as far as we know."""
        return self._sending.started

    @property
    def sent(self) -> bool:
        """Return whether a frame was sent, even a partial write."""
        return self._sending.sent

    @property
    def unanswered(self) -> bool:
        """Return whether the module did not acknowledge all of it."""
        return self._sending.unanswered != 0

    def run(self) -> Verdict:
        """Carry out the one command, and say what became of it."""
        try:
            if self.begin():
                self.end(self.look())
        except PortError as error:
            self.port_error = error
            self.lost(error)
        ((_, verdict),) = self.judged
        return verdict

    def look(self) -> int | None:
        """Read the outputs after the write; None: there was no valid reply."""
        return self._sending.look()

    def lost(self, error: PortError) -> None:
        """Judge what has no verdict yet: the port went away."""
        # It is not known how much of the frame was sent, so the verdict is "unknown".
        status = Status.UNKNOWN if self.sent else Status.FAILED
        self._judge_all(status, Reason.PORT_DOWN, detail=str(error))

    def begin(self) -> bool:
        """Send it; False: nothing was sent, and each command has its verdict."""
        if not (self._drop_late() and self._is_possible() and self._are_modes_known()):
            return False
        station, current = self._station, 0
        self._frames = self._chosen_frames()
        if self._needs_current():
            read = station.read_outputs(self._bus, READ_TRIES)
            if read is None:
                return self._judge_all(Status.FAILED, Reason.NO_REPLY, detail="nothing was sent")
            current = read
            station.interlock.observe(current, self._clock())
            running = self._running_between(current)
            if running is not None:
                return self._refuse_all(Reason.BUSY, running)
        self._values = self._wanted(current)
        objection = self._interlocked(current)
        if objection is not None:
            return self._refuse_all(Reason.INTERLOCK, objection)
        latches = station.latches_of(self._pulses)
        if latches:
            return self._refuse_all(Reason.BAD_PAYLOAD, _stays_on(latches))
        return self._send(current)

    # --- before anything is sent --------------------------------------------------------------

    def _is_possible(self) -> bool:
        """Refuse what is refused whatever the outputs are."""
        station = self._station
        if self._word is Word.TOGGLE and self.mask & station.known_pulse:
            return self._refuse_all(Reason.BAD_PAYLOAD, "a pulse output is not toggled: PRESS it")
        contradiction = station.interlock.contradiction(self._asked)
        if contradiction is not None:
            return self._refuse_all(Reason.INTERLOCK, contradiction)
        return True

    def _are_modes_known(self) -> bool:
        """Read the modes where they decide (docs/failures.md F4); False: that failed."""
        station = self._station
        self._pulses = self._pulses_asked()
        over = self._gaps() != 0 and not self._gaps() & station.read_only
        if not station.tells_settings:
            return self._asked_again() if self._pulses else True
        if not (self._pulses or over):
            return True
        tries = READ_TRIES if self._pulses else 1  # else the write can be split at the gaps
        self._modes_are_fresh = station.read_settings(self._bus, tries)
        if self._modes_are_fresh or not self._pulses:
            return True
        reason = Reason.MODULE_REFUSED if station.refuses_settings else Reason.NO_REPLY
        return self._judge_all(Status.FAILED, reason, detail=f"{_UNREADABLE}: nothing was sent")

    @property
    def _asked(self) -> int:
        """Return the outputs that are asked ON by name."""
        return sum(command.values for command in self._commands)

    def _asked_again(self) -> bool:
        """Ask a module that refused to tell its modes when it was met: it may have been busy."""
        station = self._station
        if station.modbus is None or not station.takes_modbus:
            return True
        try:
            station.learn(self._bus.exchange(station.modbus.read_settings, protected=True))
        except RefusedError as error:
            if error.code in _NEVER_TOLD:
                return True
            reason = Reason.MODULE_REFUSED
        except ExchangeError:
            reason = Reason.NO_REPLY
        else:
            station.refuses_settings = False
            self._modes_are_fresh = True
            return True
        return self._judge_all(Status.FAILED, reason, detail=f"{_UNREADABLE}: nothing was sent")

    def _pulses_asked(self) -> int:
        """Return the outputs that are to go OFF by themselves, as the sender could know."""
        if self._word is Word.PRESS:
            return self.mask
        station = self._station
        # One that is declared a pulse and latches would stay ON: its ON is refused as a PRESS is.
        return self._asked & station.known_pulse if station.settings is not None else 0

    def _chosen_frames(self) -> list[int]:
        """Return the frames: WDOX takes a mask, a Modbus range would also write its gaps."""
        station = self._station
        if not station.writer.protected:
            return [self.mask]
        spared = station.read_only if self._modes_are_fresh else self._gaps()
        return frames_for(self.mask, self._asked, spared)

    def _needs_current(self) -> bool:
        if self._word is Word.TOGGLE or self._written_over():
            return True
        return self._station.interlock.concerns(self._wanted(0))

    def _interlocked(self, current: int) -> str | None:
        """Return why the interlock forbids this write; `current` was read just now."""
        interlock = self._station.interlock
        if not interlock.concerns(self._values):
            return None
        return interlock.objection(self.mask, self._values, current, self._clock())

    def _gaps(self) -> int:
        """Return the gaps: outputs in the Modbus range that the command does not name."""
        return gaps_in(self.mask) if self._station.writer.protected else 0

    def _written_over(self) -> int:
        """Return the gaps that this write does write."""
        return self._gaps() if len(self._frames) == 1 else 0

    def _running_between(self, current: int) -> str | None:
        """Return why a range write has to wait; `current` was read just now."""
        running = self._written_over() & current & self._station.maybe_pulse
        return "an output between them holds a running pulse" if running else None

    def _wanted(self, current: int) -> int:
        if self._word is Word.TOGGLE:
            return ~current & self.mask
        if self._word is Word.PRESS:
            return self.mask
        return self._asked

    def _drop_late(self) -> bool:
        """Refuse what would go out after its deadline; False: nothing is left.

        The bus may have to wait first.
        """
        now = self._sent_at()
        return self._drop([command for command in self._commands if now > command.deadline])

    def _drop(self, late: Iterable[Command]) -> bool:
        for command in late:
            self._judge(command, Status.REFUSED, Reason.EXPIRED)
            self.mask &= ~command.mask
            self._sending.unsent = self.mask
        return bool(self._commands)

    def _sent_at(self) -> float:
        """Return when a frame would go out, at the earliest."""
        address, writer = self._station.config.address, self._station.writer
        return max(self._clock(), self._bus.free_at(address, protected=writer.protected))

    # --- on the wire --------------------------------------------------------------------------

    def _send(self, current: int) -> bool:
        merged = len(self._commands) > 1
        while self._drop_late():
            if merged:  # fewer than before, maybe
                self._values, self._frames = self._asked, self._chosen_frames()
            not_after = min(command.deadline for command in self._commands)
            try:
                self._sending.send(self._frames, self._values, current, not_after)
            except ExpiredError:
                self._drop([c for c in self._commands if c.deadline <= not_after])
                continue
            except RefusedError as error:
                self._refusal, self._refused_of = error, self._commands
            return True
        return False

    def end(self, seen: int | None) -> int | None:
        """Judge each command by what was read after the write; return what was read last."""
        if seen is not None and self._refusal is None:
            seen = self._repeat(seen)
        for command in self._refused_of:
            self._judge_refused(command)
        if seen is not None and self._commands and self._ended_by_hand(seen):
            detail = f"{_stays_on(self._pulses)}: switched OFF"
            self._judge_all(Status.FAILED, Reason.NOT_CONFIRMED, detail=detail)
        for command in self._commands:
            self._judge_by(command, seen)
        return seen

    def _wanted_again(self, seen: int) -> Sequence[Command]:
        """Return the commands for latches that may be written once more: read other than asked."""
        now, maybe_pulse = self._sent_at(), self._station.maybe_pulse
        return [
            command
            for command in self._commands
            if not command.mask & maybe_pulse
            and not self._agrees(seen, command)
            and now <= command.deadline
            and not self._newer_waits(command)
        ]

    def _repeat(self, seen: int) -> int | None:
        """Write once more what may be; return what was read after it all."""
        latest: int | None = seen
        again = self._wanted_again(seen)
        if again and (self._values & _mask(again) & ~seen or self._written_over()):
            self._held_back = self._forbidden_by_modes(again)
            if self._held_back is not None:
                return seen
            latest = self.look()
            again = [] if latest is None else self._wanted_again(latest)
        if latest is None or not again:
            return latest
        seen = latest
        self._held_back = self._running_between(seen) or self._interlocked(seen)
        if self._held_back is not None:
            return seen
        return self._send_again(again, seen)

    def _send_again(self, again: Sequence[Command], seen: int) -> int | None:
        not_after = min(command.deadline for command in again)
        try:
            self._sending.send(self._frames_of(again), self._values, seen, not_after)
        except ExpiredError:
            return seen
        except RefusedError as error:
            self._refusal, self._refused_of = error, again
        return self.look()

    def _frames_of(self, again: Sequence[Command]) -> list[int]:
        """Return the frames that say these once more, and write nothing else."""
        mask = _mask(again)
        if mask == self.mask:
            return self._frames
        return frames_for(mask, self._values, spared=self._gaps_of(mask))

    def _gaps_of(self, mask: int) -> int:
        return gaps_in(mask) if self._station.writer.protected else 0

    def _forbidden_by_modes(self, again: Sequence[Command]) -> str | None:
        """Return why nothing is repeated: a latch may have become a pulse, whose ON was sent."""
        if not self._station.read_settings(self._bus, READ_TRIES):
            return f"{_UNREADABLE}: it was not sent again"
        maybe_pulse = self._station.maybe_pulse
        if all(command.mask & maybe_pulse for command in again):
            return "the module has an output in pulse mode by now: it was not sent again"
        return None

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

    def _agrees(self, seen: int, command: Command) -> bool:
        return (seen ^ self._values) & command.mask == 0

    def _judge_by(self, command: Command, seen: int | None) -> None:
        detail = self._held_back or self._left_out()
        if seen is None:
            self._judge(command, Status.UNKNOWN, Reason.NO_REPLY, detail=detail)
            return
        mask, maybe_pulse = command.mask, self._station.maybe_pulse
        seen_on: bool | None = None
        if mask & maybe_pulse:
            seen_on = self._seen_on(seen, mask)
            if command.mask & self._sending.unanswered:
                self._judge(
                    command, Status.UNKNOWN, Reason.NO_REPLY, seen_on=seen_on, detail=detail
                )
                return
            # A pulse may end before the read, so it need not be read ON.
            mask &= ~(maybe_pulse & self.started)
        if (seen ^ self._values) & mask:
            self._judge(
                command, Status.FAILED, Reason.NOT_CONFIRMED, seen_on=seen_on, detail=detail
            )
        else:
            self._judge(command, Status.DONE, seen_on=seen_on)

    def _judge_refused(self, command: Command) -> None:
        if self._refusal is None:
            return
        detail = "; ".join(filter(None, (str(self._refusal), self._left_out())))
        self._judge(
            command,
            Status.FAILED,
            Reason.MODULE_REFUSED,
            code=self._refusal.code,
            detail=detail,
        )

    def _seen_on(self, seen: int, mask: int) -> bool | None:
        """Return whether every pulse that was started still reads ON; None: none was started."""
        started = self._station.maybe_pulse & self.started & mask
        return seen & started == started if started else None

    def _left_out(self) -> str | None:
        """Return what was never sent of a write that took several frames."""
        if not self._sending.unsent or not self.sent:
            return None
        return f"not sent to {named(self._sending.unsent)}"

    def _refuse_all(self, reason: Reason, detail: str) -> bool:
        return self._judge_all(Status.REFUSED, reason, detail=detail)

    def _judge_all(self, status: Status, reason: Reason, *, detail: str) -> bool:
        """Judge what has no verdict yet; return False: it is over."""
        for command in self._commands:
            self._judge(command, status, reason, detail=detail)
        return False

    def _judge(
        self,
        command: Command,
        status: Status,
        reason: Reason | None = None,
        *,
        code: int | None = None,
        seen_on: bool | None = None,
        detail: str | None = None,
    ) -> None:
        verdict = verdict_on(
            command, self._clock(), status, reason, code=code, seen_on=seen_on, detail=detail
        )
        self.judged.append((command, verdict))
        self._commands = tuple(other for other in self._commands if other is not command)


def _mask(commands: Iterable[Command]) -> int:
    return sum(command.mask for command in commands)


def _stays_on(outputs: int) -> str:
    return f"the module has {named(outputs)} in latch mode, where it would stay ON"
