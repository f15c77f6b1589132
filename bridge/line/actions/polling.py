"""Carries out one poll, and handles its reply or its failure."""

from collections.abc import Callable, Mapping

from bridge.errors import BadReplyError, ExchangeError, NoReplyError, RefusedError
from bridge.line.actions.automation import Automation
from bridge.line.actions.contact import make_contact, wrong_model
from bridge.line.exchanger import Exchanger
from bridge.line.plan.plan import PollPlan
from bridge.line.plan.streams import Poll
from bridge.line.report import LineReport
from bridge.line.rules.presence import Kind, fallen_silent
from bridge.line.rules.tracker import Outcome
from bridge.line.station import Station
from bridge.line.statistics import LineStatistics


class Polling:
    """The reads of a line worker. Only its thread uses it."""

    def __init__(
        self,
        stations: Mapping[int, Station],
        plan: PollPlan,
        report: LineReport,
        statistics: LineStatistics,
        automation: Automation,
        *,
        port_used: Callable[[], None],
        clock: Callable[[], float],
    ) -> None:
        self._stations = stations
        self._presences = {a: station.presence for a, station in stations.items()}
        self._plan = plan
        self._report = report
        self._statistics = statistics
        self._automation = automation
        self._port_used = port_used
        self._clock = clock

    def waiting(self, bus: Exchanger) -> frozenset[int]:
        """Return the stations whose values are not read yet: a late reply could pass for theirs."""
        if bus.quiet_until <= self._clock():
            return frozenset()
        return frozenset(a for a, one in self._stations.items() if not one.writer.protected)

    def has_to_wait(self, bus: Exchanger, poll: Poll) -> bool:
        """Return whether a late reply could be taken for the reply to this read."""
        if bus.quiet_until <= self._clock():
            return False
        station = self._stations[poll.address]
        if poll.kind is Kind.CONTACT:
            return station.knocker is None
        return poll.kind is not Kind.SETTINGS and not station.writer.protected

    def poll(self, bus: Exchanger, poll: Poll) -> None:
        """Make one read. Raises PortError."""
        station = self._stations[poll.address]
        if station.presence.online is (poll.kind is Kind.CONTACT):
            return  # it came or went since this read was planned
        if poll.kind is Kind.CONTACT:
            self._contact(bus, station)
        elif poll.kind is Kind.SETTINGS:
            self._read_settings(bus, station)
        else:
            self._read(bus, station, poll)

    def _read(self, bus: Exchanger, station: Station, poll: Poll) -> None:
        inputs = poll.kind is Kind.INPUTS
        bank = station.inputs if inputs else station.outputs
        reader = station.asker(bank, late=bus.quiet_until > self._clock())
        request = reader.read_inputs if inputs else reader.read_outputs
        if bank.is_waiting or station.is_contested:
            station.let_others_pass(bus)
        asked_at = self._clock()
        try:
            raw = bus.exchange(request, protected=reader.protected)
        except ExchangeError as error:
            if not self._was_exchanged(bus, station, error):
                self._missed(station, poll.kind, error, bus.free_at(poll.address))
            return
        now = self._clock()
        if station.presence.misses > 1:
            self._doubt_settings(station)  # a module can be replaced before it counts as offline
        station.presence.answered(now)
        self._statistics.was_read(poll, now)
        before, confirmed_at = bank.value, bank.confirmed_at
        outcome = bank.observe(
            raw,
            now,
            asked_at=asked_at,
            protected=reader.protected,
            apart_s=station.apart_s(reader),
        )
        confirmed = outcome is Outcome.UNCHANGED or outcome is Outcome.CHANGED
        if not inputs:
            # ON counts at once, OFF only after it is confirmed: in doubt the interlock refuses.
            station.interlock.observe(raw | (bank.value or 0), now)
            if confirmed:
                station.found(bank.value or 0, now)
        if outcome is Outcome.READ_AGAIN:
            self._plan.again(poll)
        elif outcome is Outcome.CHANGED:
            self._changed(station, poll, before, confirmed_at)
        if confirmed and inputs and station.buttons is not None:
            made = self._report.gestures(station, now)
            self._automation.pressed(station, made, confirmed_at)

    def _changed(
        self, station: Station, poll: Poll, before: int | None, unchanged_at: float
    ) -> None:
        self._report.values(station)
        if poll.kind is Kind.INPUTS:
            self._plan.changed(poll)
            self._report.edges(station, before)
            self._automation.changed(station, before, unchanged_at)
        elif self._report.unasked(station, before):
            self._doubt_settings(station)

    def _doubt_settings(self, station: Station) -> None:
        """Request a read of the settings soon, after something happened to the module."""
        if station.tells_settings:
            self._plan.appoint(Poll(station.config.address, Kind.SETTINGS), self._clock())

    def _read_settings(self, bus: Exchanger, station: Station) -> None:
        """Read the settings with one exchange; if it fails, the next one follows in a minute."""
        before = station.settings
        if station.tells_settings:
            station.read_settings(bus, tries=1)
        if station.settings != before:
            self._report.settings(station)

    def _was_exchanged(self, bus: Exchanger, station: Station, error: ExchangeError) -> bool:
        """Return whether another model answers now; ask it after a reply that does not fit.

        The module is then contacted as a new one, so nothing is written with old knowledge.
        """
        second_time = isinstance(error, BadReplyError) and station.presence.misses == 1
        if not second_time and not isinstance(error, RefusedError):
            return False
        try:
            complaint = wrong_model(station.config.model, station.contact_asker, bus)
        except ExchangeError:
            return False
        if complaint is None:
            return False
        station.forget()
        station.is_unknown = True
        station.presence.lost(self._clock())
        self._statistics.gone(station.config.address)
        self._report.exchanged(station, complaint)
        return True

    def lost(self) -> None:
        """Contact every module again: the port was lost."""
        self.ask_anew()
        for station in self._stations.values():
            station.forget()
        self._statistics.lost()

    def ask_anew(self) -> None:
        """Contact every module again: a new connection is opened."""
        now = self._clock()
        for station in self._stations.values():
            station.presence.lost(now)

    def _missed(self, station: Station, kind: Kind, error: ExchangeError, free_at: float) -> None:
        now = self._clock()
        station.presence.missed(kind, now, free_at)
        station.last_error = error
        self._statistics.missed(station.config.address)
        self.judge_silence()

    def judge_silence(self) -> None:
        """Take modules offline that did not answer reads or orders for long enough."""
        now = self._clock()
        for address in fallen_silent(self._presences, now):
            self._gone(self._stations[address], now)

    def _gone(self, station: Station, now: float) -> None:
        error = station.last_error or NoReplyError("no module on the line answers")
        station.presence.gone(now)
        station.forget()
        station.is_unknown = True
        self._statistics.gone(station.config.address)
        self._report.absent(station, error)
        self._report.gone(station, str(error))

    def _contact(self, bus: Exchanger, station: Station) -> None:
        """Contact an offline station; if it answers, read everything about it."""
        if station.is_unknown:
            bus.forget(station.config.address)
            station.is_unknown = False
        begun, urgent = self._clock(), station.presence.urgent
        try:
            complaint = make_contact(station, bus, self._clock)
        except ExchangeError as error:
            self._port_used()
            station.forget()
            station.vain_contacts += 1
            if station.presence.silent_since(begun):
                station.presence.absent(self._clock())
            else:
                station.presence.interrupted(self._clock())
            if not urgent:  # these have their own limit: see `UrgentProbes`
                self._count_vain(bus, begun)
            self._report.absent(station, error)
            return
        self._port_used()
        station.took_modbus, station.vain_contacts = station.takes_modbus, 0
        if complaint is not None:
            station.presence.absent(self._clock())  # next contact later and later
            self._report.gone(station, complaint)
            self._report.wrong_model(station, complaint)
            return
        now = self._clock()
        station.presence.arrived(now)
        self._report.met(station, now)
        self._report.gestures(station, now)  # no gestures yet: they begin from here

    def _count_vain(self, bus: Exchanger, begun: float) -> None:
        """Tell the plan for how long a contact without an answer kept the others waiting."""
        now = free_at = self._clock()
        online = (one for one in self._stations.values() if one.presence.online)
        if not all(one.writer.protected for one in online):
            free_at = max(now, bus.quiet_until)
        self._plan.probed_in_vain(free_at - begun, free_at)
