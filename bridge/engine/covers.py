"""The covers of a line: who takes which command, and whose turn it is."""

from collections.abc import Callable, Iterable

from bridge.engine.cover_drive import CoverDrive
from bridge.engine.report import LineReport
from bridge.engine.station import Exchanger, Station
from bridge.engine.switching import Switcher
from bridge.model import CoverCommand, LineEvent, Reason

_HALT_S = 1.5  # at the end of the worker: how long a module that does not obey is tried


class Covers:
    """All covers of one line. Only its thread uses it."""

    def __init__(
        self,
        stations: Iterable[Station],
        switcher: Switcher,
        report: LineReport,
        emit: Callable[[LineEvent], None],
        clock: Callable[[], float],
    ) -> None:
        self._report = report
        self._clock = clock
        self._stations = [station for station in stations if station.covers]
        self._drives = {
            (station.config.id, cover.id): CoverDrive(
                cover,
                station.covers[cover.id],
                station,
                switcher=switcher,
                report=report,
                emit=emit,
                clock=clock,
            )
            for station in self._stations
            for cover in station.config.covers
        }

    def take(self, command: CoverCommand, bus: Exchanger) -> None:
        """Carries out a command, or begins to. A PortError goes up."""
        self._drives[command.station, command.cover].take(command, bus)

    def overruled(self, station: str, outputs: int) -> None:
        """A command to these outputs comes: what waits for one of them is not done."""
        for (name, _), drive in self._drives.items():
            if name == station:
                drive.overruled(outputs)

    def work(self, bus: Exchanger) -> None:
        """Makes at most one write that is due, and tells where the covers are."""
        for drive in self._drives.values():
            drive.drop_late()  # before any write, which may take 2 s
        for drive in self._drives.values():
            if drive.work(bus):
                break
        for station in self._stations:
            if station.presence.online:
                self._report.covers(station, self._clock())

    def drop(self, reason: Reason) -> None:
        """What waits is not done."""
        for drive in self._drives.values():
            drive.drop(reason)

    def halt(self, bus: Exchanger) -> None:
        """The line ends: no motor may run on. A PortError goes up.

        Each is told to stop once, and what does not obey again for a while. What is known not to
        answer comes last: it must not keep the others running.
        """
        until = self._clock() + _HALT_S
        while running := [drive for drive in self._drives.values() if drive.is_to_halt]:
            for drive in sorted(running, key=lambda drive: drive.is_silent):
                drive.halt(bus)
            if self._clock() > until:
                return

    def tell_left(self) -> None:
        """Says of which motors nobody knows whether they were switched OFF."""
        for drive in self._drives.values():
            drive.tell_left()
