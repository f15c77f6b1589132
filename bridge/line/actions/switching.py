"""Carries out what is ordered of outputs and settings, and tells what it changed."""

from collections.abc import Callable

from bridge.line.actions.sending import READ_TRIES
from bridge.line.actions.settings_write import SettingsWrite
from bridge.line.actions.writes import Write
from bridge.line.exchanger import Exchanger
from bridge.line.plan.plan import PollPlan
from bridge.line.plan.streams import Poll
from bridge.line.report import LineReport
from bridge.line.rules.presence import Kind
from bridge.line.station import Station
from bridge.model import AnyCommand, Command, Reason, SettingCommand, Status, Verdict

# A pulse is over when the module's clock says so, which is none of the best.
_CLOCKS_DIFFER = 1.02


class Switcher:
    """The writing half of a line worker. Only its thread uses it.

    `newer_than` tells whether a command waits that is newer and names the same outputs.

    Attributes:
        sent: Whether anything of the last order was sent.
    """

    def __init__(
        self,
        plan: PollPlan,
        report: LineReport,
        newer_than: Callable[[AnyCommand], bool],
        clock: Callable[[], float],
    ) -> None:
        self.sent = False
        self._lost: Write | SettingsWrite | None = None  # the order that lost the port
        self._plan = plan
        self._report = report
        self._newer_than = newer_than
        self._clock = clock

    def switch(self, command: Command, station: Station, bus: Exchanger) -> Verdict:
        """Make one write. What it changed is told; the verdict is for the caller to tell."""
        before, settings = station.outputs.value, station.settings
        write = Write(command, station, bus, self._clock, lambda: self._newer_than(command))
        verdict = write.run()
        outputs = Poll(station.config.address, Kind.OUTPUTS)
        for hold_s in station.holds_s(write.started):
            self._plan.appoint(outputs, self._clock() + hold_s * _CLOCKS_DIFFER)
        if station.settings != settings:
            self._report.settings(station)
        if station.outputs.value != before:
            self._report.values(station)
            self._report.covers(station, self._clock())
            self._report.unasked(station, before, asked=command.mask)
        station.commanded(command.mask, verdict)
        if verdict.reason is Reason.NO_REPLY:
            station.unanswered_at = self._clock()
            station.presence.ignored(self._clock(), READ_TRIES)
        self.sent = write.sent
        self._keep_lost(write)
        return verdict

    def set(self, command: SettingCommand, station: Station, bus: Exchanger) -> Verdict:
        """Write one mode or hold time, as `switch` does with outputs."""
        before = station.settings
        write = SettingsWrite(command, station, bus, self._clock)
        verdict = write.run()
        if verdict.status is Status.DONE:
            station.accept(command.output)
        if station.settings != before:
            self._report.settings(station)
        self._keep_lost(write)
        return verdict

    def newer_than(self, command: AnyCommand) -> bool:
        """Return whether a command waits that came later and names an output of `command`."""
        return self._newer_than(command)

    def raise_lost(self) -> None:
        """Raise what made the port go away in an order: after its verdict was told."""
        lost, self._lost = self._lost, None  # else it would be raised for a later order
        if lost is not None and lost.port_error is not None:
            raise lost.port_error

    def _keep_lost(self, write: Write | SettingsWrite) -> None:
        if write.port_error is not None:
            self._lost = write
