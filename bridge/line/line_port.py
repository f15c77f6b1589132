"""Reports changes of the port of a line and of its modules, by the rules of `port_life`."""

from collections.abc import Callable, Collection

from bridge.config.schema import LineConfig
from bridge.errors import PortError
from bridge.line.report import LineReport
from bridge.line.rules.port_life import PortLife
from bridge.line.station import Station


class LinePort:
    """The port of one line worker. Only its thread uses it.

    Attributes:
        is_resting: It is closed because it is not needed.
    """

    def __init__(
        self,
        config: LineConfig,
        stations: Collection[Station],
        report: LineReport,
        clock: Callable[[], float],
    ) -> None:
        self.is_resting = False
        self._stations = stations
        self._report = report
        self._clock = clock
        self._life = PortLife(gateway="://" in config.port)
        self._detail = ""

    @property
    def open_at(self) -> float:
        """Return when to open it, while it is closed."""
        return self._life.open_at

    def opened(self) -> None:
        """Record that it was opened."""
        self.is_resting = False
        self._life.opened(self._clock())

    def used(self) -> None:
        """Record an exchange: a port that opens and hangs up at once never gets here."""
        self._life.is_used = True
        self.tick()

    def lost(self, error: PortError) -> bool:
        """Record that it is gone; return whether that is an error: then contact all modules."""
        now = self._clock()
        if self._life.is_idle_close(now, anybody=self._is_anybody_online()):
            self.is_resting = True
            self._life.rest(min(station.presence.probe_at for station in self._stations))
            return False
        if self._life.is_drop and self._life.may_tell_drop(now):
            self._report.dropped(str(error))
        self._life.lost(now)
        self._detail = str(error)
        return True

    def is_deaf(self) -> bool:
        """Return whether to open it again because no module answers (docs/failures.md F20)."""
        now = self._clock()
        if self._is_anybody_online():
            self._life.heard(now)
            return False
        deaf = self._life.is_deaf(now)
        if deaf and self._life.may_tell_silence(now):
            self._report.unanswered()
        return deaf

    def tick(self) -> None:
        """Report what is due."""
        now = self._clock()
        if self._life.is_missed:
            self._miss(now)
        if self._life.is_up_due(now):
            self._life.told(now, online=True)
            self._report.up()
            for station in self._stations:
                if station.presence.online:
                    self._report.online(station)

    def _miss(self, now: float) -> None:
        """Record that it was lost: wait for port and modules, but not for long."""
        missed = [s for s in self._stations if s.told_online and not s.presence.online]
        if self._life.is_used and not missed:
            self._life.recovered()
        elif self._life.is_down_due(now):
            for station in missed:
                self._report.gone(station, self._detail)
            if not self._life.is_used:
                self._report.down(self._detail)
                self._life.told(now, online=False)

    def _is_anybody_online(self) -> bool:
        return any(station.presence.online for station in self._stations)
