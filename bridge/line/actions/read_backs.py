"""Writes that wait to be read back: those to other stations, or outputs, go out before that."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bridge.errors import PortError
from bridge.line.actions.switching import Switcher
from bridge.line.actions.writes import Write
from bridge.line.exchanger import Exchanger
from bridge.line.station import Station
from bridge.model import Command, LineEvent, OutputSettings

# A verdict, and the repeat of what was lost, must not wait for ever for commands that keep coming.
WITHIN_S = 0.5


@dataclass(frozen=True, slots=True)
class _Written:
    """What one read of a station judges.

    Attributes:
        writes: All that went out since it was read, the oldest first.
        since: When the first of them went out.
        settings: Its modes and hold times as they were known then.
    """

    station: Station
    writes: list[Write]
    since: float
    settings: OutputSettings | None

    @property
    def unanswered(self) -> bool:
        """Return whether the module did not acknowledge its last write: it may be dead."""
        return self.writes[-1].unanswered


class ReadBacks:
    """The writes of one line that are out and not judged. Only its thread uses it.

    Modules that acknowledged come first: one that did not may take 2 s to be read. What waits is
    read back before the line does anything but commands.
    """

    def __init__(
        self,
        switcher: Switcher,
        emit: Callable[[LineEvent], None],
        clock: Callable[[], float],
    ) -> None:
        self._switcher = switcher
        self._emit = emit
        self._clock = clock
        self._written: dict[str, _Written] = {}

    def __contains__(self, station: object) -> bool:
        return station in self._written

    def may_be_dead(self, station_id: str) -> bool:
        """Return whether it did not acknowledge what waits to be read back."""
        return station_id in self._written and self._written[station_id].unanswered

    def write(self, commands: Sequence[Command], station: Station, bus: Exchanger) -> None:
        """Send commands in one write; their verdicts come with the read, or without one sent.

        A PortError goes up.
        """
        settings = station.settings
        write = self._switcher.write(commands, station, bus)
        try:
            if not write.begin():
                return
        except PortError as error:
            write.lost(error)
            raise
        finally:
            self._tell([write])  # those that were too late, or all
        station.unsettled |= write.mask  # not unasked, if another read finds them changed
        written = _Written(station, [], self._clock(), settings)
        self._written.setdefault(station.config.id, written).writes.append(write)

    def goes_first(
        self, commands: Sequence[Command] | None, station_id: str, *, stalls: bool
    ) -> bool:
        """Return whether something is to be read back before a station is told anything.

        Args:
            commands: What may be written before it is read back; None: what has to wait for that.
            station_id: The station.
            stalls: Whether it does not answer just now: then everything else comes first.
        """
        own = self._written.get(station_id)
        if own is not None:
            asked = sum(command.mask for command in commands or ())
            names_the_same = any(write.mask & asked for write in own.writes)
            if commands is None or own.unanswered or names_the_same:
                return True
        answered = [one for one in self._written.values() if not one.unanswered]
        if stalls and answered:
            return True
        return any(self._clock() - one.since > WITHIN_S for one in answered)

    def work(self, wanted: str = "") -> bool:
        """Read one station back, `wanted` if it answers; False: none waits. A PortError goes up."""
        answered = [name for name, one in self._written.items() if not one.unanswered]
        waiting = answered or list(self._written)
        if not waiting:
            return False
        self._judge(self._written.pop(wanted if wanted in waiting else waiting[0]))
        return True

    def lost(self, error: PortError) -> None:
        """Judge all: the port went away."""
        while self._written:
            _, written = self._written.popitem()
            for write in written.writes:
                write.lost(error)
            self._conclude(written, written.station.outputs.value)

    def _judge(self, written: _Written) -> None:
        station, writes = written.station, written.writes
        before = station.outputs.value
        try:
            # One that is offline by now is met as a stranger, before anything of it is read.
            seen = writes[0].look() if station.presence.online else None
            for write in writes:
                seen = write.end(seen)
        except PortError as error:
            for write in writes:
                write.lost(error)
            raise
        finally:
            self._conclude(written, before)

    def _conclude(self, written: _Written, before: int | None) -> None:
        self._switcher.conclude(written.writes, written.station, before, written.settings)
        self._tell(written.writes)

    def _tell(self, writes: Sequence[Write]) -> None:
        for write in writes:
            for _, verdict in write.judged:
                self._emit(verdict)
            write.judged.clear()
