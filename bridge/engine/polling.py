"""Carries out one poll, and draws the conclusions of what came back or did not."""

from collections.abc import Callable, Mapping

from bridge.engine.contact import make_contact
from bridge.engine.plan import PollPlan
from bridge.engine.presence import Kind, fallen_silent
from bridge.engine.report import LineReport
from bridge.engine.station import Exchanger, Station
from bridge.engine.statistics import LineStatistics
from bridge.engine.streams import Poll
from bridge.engine.tracker import Outcome
from bridge.errors import ExchangeError, NoReplyError, PortError


class Polling:
    """The reading half of a line worker. Only its thread uses it."""

    def __init__(
        self,
        stations: Mapping[int, Station],
        plan: PollPlan,
        report: LineReport,
        statistics: LineStatistics,
        clock: Callable[[], float],
    ) -> None:
        self._stations = stations
        self._presences = {a: station.presence for a, station in stations.items()}
        self._plan = plan
        self._report = report
        self._statistics = statistics
        self._clock = clock

    def poll(self, bus: Exchanger, poll: Poll) -> None:
        """Makes the read that is due. A PortError goes up."""
        station = self._stations[poll.station]
        if poll.kind is Kind.CONTACT:
            self._contact(bus, station)
            return
        inputs = poll.kind is Kind.INPUTS
        reader = station.reader
        request = reader.read_inputs if inputs else reader.read_outputs
        bank = station.inputs if inputs else station.outputs
        try:
            raw = bus.exchange(request, protected=reader.protected)
        except ExchangeError as error:
            self._missed(station, poll.kind, error, bus.free_at(poll.station))
            return
        now = self._clock()
        station.presence.answered(now)
        self._statistics.read(poll, now)
        before = bank.value
        outcome = bank.read(raw, now)
        if not inputs:
            # ON counts at once, OFF only when it is confirmed: doubt keeps an interlock shut.
            station.interlock.read(raw | (bank.value or 0), now)
            if outcome is not Outcome.READ_AGAIN:
                station.found(bank.value or 0, now)
        if outcome is not Outcome.UNCHANGED:
            if outcome is Outcome.READ_AGAIN:
                self._plan.again(poll)
                return
            self._changed(station, poll, before)
        if inputs and station.buttons is not None:
            self._report.gestures(station, now)

    def _changed(self, station: Station, poll: Poll, before: int | None) -> None:
        self._report.values(station)
        if poll.kind is Kind.INPUTS:
            self._plan.changed(poll)
            self._report.edges(station, before)
        else:
            self._report.unasked(station, before)

    def lost(self, error: PortError) -> None:
        """The port went away: everything is to be met anew."""
        now = self._clock()
        for station in self._stations.values():
            if station.presence.online:
                self._report.gone(station, str(error))
            station.presence.lost(now)
            station.forget()
        self._statistics.lost()
        self._report.down(str(error))

    def _missed(self, station: Station, kind: Kind, error: ExchangeError, free_at: float) -> None:
        now = self._clock()
        station.presence.missed(kind, now, free_at)
        station.last_error = error
        self._statistics.missed(station.config.address)
        for address in fallen_silent(self._presences, now):
            self._gone(self._stations[address], now)

    def _gone(self, station: Station, now: float) -> None:
        error = station.last_error or NoReplyError("nobody on the line answers")
        station.presence.gone(now)
        station.forget()
        self._statistics.gone(station.config.address)
        self._report.absent(station, error)
        self._report.gone(station, str(error))

    def _contact(self, bus: Exchanger, station: Station) -> None:
        """Asks a station that is offline; if it answers, everything about it is read."""
        try:
            complaint = make_contact(station, bus, self._clock)
        except ExchangeError as error:
            self._report.up()
            station.forget()
            station.presence.absent(self._clock())
            self._report.absent(station, error)
            return
        self._report.up()
        if complaint is not None:
            station.presence.absent(self._clock())  # asked again, ever more rarely
            self._report.wrong_model(station, complaint)
            return
        now = self._clock()
        station.presence.arrived(now)
        self._report.met(station, now)
        self._report.gestures(station, now)  # none: that is where they begin from
