"""Carries out one command on the wire, and says what became of it.

The rules of CONTRACT.md: a pulse is sent at most once; a latch write is repeated at most
once, and not when a newer command for that output waits; nothing is sent after its deadline;
`done` takes a read after the write that agrees; interlocked outputs are never ON together.
"""

from collections.abc import Callable

from bridge.engine.station import Exchanger, Station
from bridge.errors import ExchangeError, ExpiredError, PortError, RefusedError
from bridge.model import AnyCommand, Command, Reason, Status, Verdict, Word

# The write and these take less than 2 s where nobody answers, so that the others wait no longer.
_READ_TRIES = 3


class Write:
    """One command on its way. Used once, by the thread of the line.

    Attributes:
        started: The outputs that were switched ON, as far as we know.
        sent: Whether a write went out, be it in part.
        port_error: Set if the port went away meanwhile.
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
        self.sent = False
        self._values = 0
        self._held_back: str | None = None  # why a repeat was not made
        self.started = 0
        self.port_error: PortError | None = None

    def run(self) -> Verdict:
        """Does it, and says what became of it."""
        try:
            return self._carry_out()
        except PortError as error:
            self.port_error = error
            # Not knowing how much of the frame got out, only "unknown" is true.
            status = Status.UNKNOWN if self.sent else Status.FAILED
            return self._verdict(status, Reason.PORT_DOWN, detail=str(error))

    def _carry_out(self) -> Verdict:
        station, current = self._station, 0
        refusal = self._refusal_unread()
        if refusal is not None:
            return refusal
        if self._needs_current():
            read = station.read_outputs(self._bus, _READ_TRIES)
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
        return self._send(current)

    def _refusal_unread(self) -> Verdict | None:
        """What can be refused whatever the outputs are."""
        command, station = self._command, self._station
        if self._is_late():
            return self._refused(Reason.EXPIRED)
        if command.word is Word.TOGGLE and command.mask & station.known_pulse:
            return self._refused(Reason.BAD_PAYLOAD, "a pulse output is not toggled: PRESS it")
        contradiction = station.interlock.contradiction(command.values)
        if contradiction is not None:
            return self._refused(Reason.INTERLOCK, contradiction)
        return None

    def _needs_current(self) -> bool:
        if self._command.word is Word.TOGGLE or self._gaps() != 0:
            return True
        return self._station.interlock.concerns(self._wanted(0))

    def _interlocked(self, current: int) -> str | None:
        """Why the interlock forbids this write, where `current` was just read."""
        interlock, mask = self._station.interlock, self._command.mask
        if not interlock.concerns(self._values):
            return None
        return interlock.objection(mask, self._values, current, self._clock())

    def _gaps(self) -> int:
        """Outputs that a Modbus range write would write besides those that were named."""
        mask = self._command.mask
        if not self._station.writer.protected:
            return 0  # WDOX takes a mask (PROTOCOL.md section 2)
        lowest = mask & -mask
        return ((1 << mask.bit_length()) - lowest) & ~mask

    def _running_between(self, current: int) -> str | None:
        """Why a range write has to wait, where `current` was just read."""
        running = self._gaps() & current & self._station.maybe_pulse
        return "an output between them holds a running pulse" if running else None

    def _wanted(self, current: int) -> int:
        command = self._command
        if command.word is Word.TOGGLE:
            return ~current & command.mask
        if command.word is Word.PRESS:
            return command.mask
        return command.values

    def _send(self, current: int) -> Verdict:
        command, station = self._command, self._station
        once = command.mask & station.maybe_pulse != 0
        if self._is_late():
            return self._refused(Reason.EXPIRED)
        try:
            acknowledged = self._transmit(current)
            seen = self._look()
            if seen is not None and not once and self._may_repeat(seen):
                seen = self._repeat(seen)
        except ExpiredError:
            return self._refused(Reason.EXPIRED)
        except RefusedError as error:
            self._look()
            return self._verdict(
                Status.FAILED, Reason.MODULE_REFUSED, code=error.code, detail=str(error)
            )
        return self._judge(once=once, acknowledged=acknowledged, seen=seen)

    def _repeat(self, seen: int) -> int | None:
        """Writes once more, where `seen` was just read; returns what was read after it all."""
        try:
            self._transmit(seen)
        except ExpiredError:
            return seen
        return self._look()

    def _is_late(self) -> bool:
        """Whether a frame would go out after the deadline: the bus may have to wait first."""
        free_at = self._bus.free_at(self._station.config.address)
        return max(self._clock(), free_at) > self._command.deadline

    def _may_repeat(self, seen: int) -> bool:
        """A latch that was read back other than asked may be written once more."""
        if self._agrees(seen, self._command.mask) or self._is_late() or self._newer_waits():
            return False
        self._held_back = self._running_between(seen) or self._interlocked(seen)
        return self._held_back is None

    def _transmit(self, current: int) -> bool:
        """One transmission; tells whether it was acknowledged.

        Raises:
            ExpiredError: Nothing was sent: the deadline passed before the line was free.
            RefusedError: The module says no.
        """
        writer, deadline = self._station.writer, self._command.deadline
        request = writer.write_outputs(self._command.mask, self._values, current)
        try:
            self._bus.exchange(request, protected=writer.protected, not_after=deadline)
        except (RefusedError, PortError):
            self._went_out()
            raise
        except ExchangeError:
            self._went_out()
            return False
        self._went_out()
        return True

    def _went_out(self) -> None:
        self.sent = True
        self.started = self._values
        self._station.ordered(self._command.mask, self._values, self._bus.sent_at)

    def _look(self) -> int | None:
        """The read after the write: it is the state, whatever the acknowledgement said."""
        seen = self._station.read_outputs(self._bus, _READ_TRIES)
        if seen is not None:
            self._station.outputs.value = seen
            self._station.interlock.read(seen, self._clock())
            self._station.found(seen, self._clock())
        return seen

    def _agrees(self, seen: int, mask: int) -> bool:
        return (seen ^ self._values) & mask == 0

    def _judge(self, *, once: bool, acknowledged: bool, seen: int | None) -> Verdict:
        if seen is None:
            return self._verdict(Status.UNKNOWN, Reason.NO_REPLY)
        mask = self._command.mask
        if not once:
            if self._agrees(seen, mask):
                return self._verdict(Status.DONE)
            return self._verdict(Status.FAILED, Reason.NOT_CONFIRMED, detail=self._held_back)
        # A pulse may be over before the read sees it: ON is not demanded of those.
        demanded = mask & ~(self._station.maybe_pulse & self._values)
        seen_on = self._seen_on(seen)
        if not acknowledged:
            return self._verdict(Status.UNKNOWN, Reason.NO_REPLY, seen_on=seen_on)
        if not self._agrees(seen, demanded):
            return self._verdict(Status.FAILED, Reason.NOT_CONFIRMED, seen_on=seen_on)
        return self._verdict(Status.DONE, seen_on=seen_on)

    def _seen_on(self, seen: int) -> bool | None:
        """Whether every pulse that was started still reads ON; None: none was started."""
        started = self._station.maybe_pulse & self._values
        return seen & started == started if started else None

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


def verdict_on(
    command: AnyCommand,
    now: float,
    status: Status,
    reason: Reason | None = None,
    *,
    code: int | None = None,
    seen_on: bool | None = None,
    detail: str | None = None,
) -> Verdict:
    """The verdict on `command`, given at `now`."""
    return Verdict(
        station=command.station,
        target=command.target,
        payload=command.payload,
        status=status,
        ms=round((now - command.arrived) * 1000),
        reason=reason,
        id=command.id,
        code=code,
        seen_on=seen_on,
        detail=detail,
        reply_to=command.reply_to,
    )
