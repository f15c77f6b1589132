"""Carries out orders to outputs and settings, and reports the changes."""

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

# The end of a pulse depends on the clock of the module, which is not exact.
_CLOCKS_DIFFER = 1.02


class Switcher:
    """The writes of a line worker. Only its thread uses it.

    `newer_than` returns whether a newer command for the same outputs waits.

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
        self._lost: Write | SettingsWrite | None = None  # the order during which the port was lost
        self._plan = plan
        self._report = report
        self._newer_than = newer_than
        self._clock = clock

    def switch(self, command: Command, station: Station, bus: Exchanger) -> Verdict:
        """Make one write and report the changes; return the verdict, which the caller reports."""
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
        """Write one mode or hold time; otherwise as `switch`."""
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
        """Return whether a newer command waits that names an output of `command`."""
        return self._newer_than(command)

    def raise_lost(self) -> None:
        """Raise the error by which an order lost the port, after its verdict was reported."""
        lost, self._lost = self._lost, None  # so that it is not raised again for a later order
        if lost is not None and lost.port_error is not None:
            raise lost.port_error

    def _keep_lost(self, write: Write | SettingsWrite) -> None:
        if write.port_error is not None:
            self._lost = write
