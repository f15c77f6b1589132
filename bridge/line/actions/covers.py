"""The covers of a line: which one takes a command, and which one writes next."""

from collections.abc import Callable, Iterable

from bridge.line.actions.cover_drive import CoverDrive
from bridge.line.actions.switching import Switcher
from bridge.line.exchanger import Exchanger
from bridge.line.report import LineReport
from bridge.line.station import Station
from bridge.model import (
    CoverCommand,
    LeftCover,
    LineEvent,
    Reason,
    StandingCover,
    StandingCovers,
)


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

    def __bool__(self) -> bool:
        return bool(self._drives)

    def carry_out(self, command: CoverCommand, bus: Exchanger) -> None:
        """Carry out a command, or begin to. Raises PortError."""
        self._drives[command.station_id, command.cover].carry_out(command, bus)

    def overruled(self, station_id: str, outputs: int) -> None:
        """Drop waiting commands to these outputs: a newer command names them."""
        for (name, _), drive in self._drives.items():
            if name == station_id:
                drive.overruled(outputs)

    def work(self, bus: Exchanger) -> None:
        """Make at most one write that is due, and publish where the covers are."""
        for drive in self._drives.values():
            drive.drop_late()  # before any write, which may take 2 s
        for drive in self._drives.values():
            if drive.work(bus):
                break
        for station in self._stations:
            if station.presence.online:
                self._report.covers(station, self._clock())

    def drop(self, reason: Reason) -> None:
        """Refuse every command that waits."""
        for drive in self._drives.values():
            drive.drop(reason)

    # --- motors that may run --------------------------------------------------------------------

    def overdue(self) -> list[Station]:
        """Return the absent modules with a motor that may run and should have stopped."""
        now = self._clock()
        return [
            station
            for station in self._stations
            if not station.presence.online
            and any(motion.is_over(now) for motion in station.covers.values())
        ]

    def running(self) -> dict[int, int]:
        """Return the outputs of motors that may be ON, by address."""
        running: dict[int, int] = {}
        for drive in self._drives.values():
            if outputs := drive.running:
                running[drive.address] = running.get(drive.address, 0) | outputs
        return running

    @property
    def left(self) -> tuple[LeftCover, ...]:
        """Return the covers whose motor may run."""
        return tuple(drive.left for drive in self._drives.values() if drive.running)

    @property
    def standing(self) -> StandingCovers:
        """Return the covers of present modules that stand at a known position."""
        return tuple(
            StandingCover(station.config.address, station.config.id, name, motion.build, position)
            for station in self._stations
            if station.presence.online
            for name, motion in station.covers.items()
            if (position := motion.standing) is not None
        )

    def inherit(self, left: Iterable[LeftCover], standing: Iterable[StandingCover] = ()) -> None:
        """Take over what another line left moving or standing, if it is on this line."""
        stood = {
            (one.address, one.station_id, one.cover, one.build): one.position for one in standing
        }
        for station in self._stations:
            for name, motion in station.covers.items():
                place = (station.config.address, station.config.id, name, motion.build)
                if place in stood:
                    motion.recall(stood[place])
        for one in left:
            for station in self._stations:
                if station.config.id == one.station_id and one.cover in station.covers:
                    station.covers[one.cover].left = True

    def tell_left(self) -> None:
        """Report each motor that was not read OFF."""
        for drive in self._drives.values():
            drive.tell_left()
