"""Carries out orders to outputs and settings, and reports the changes."""

from collections.abc import Callable, Sequence

from bridge.errors import PortError
from bridge.line.actions.sending import READ_TRIES
from bridge.line.actions.settings_write import SettingsWrite
from bridge.line.actions.writes import Write
from bridge.line.exchanger import Exchanger
from bridge.line.plan.plan import PollPlan
from bridge.line.plan.streams import Poll
from bridge.line.report import LineReport
from bridge.line.rules.presence import Kind
from bridge.line.station import Station
from bridge.model import (
    AnyCommand,
    Command,
    OutputSettings,
    Reason,
    SettingCommand,
    Status,
    Verdict,
)

# The end of a pulse depends on the clock of the module, which is not exact.
_CLOCKS_DIFFER = 1.02


class OrderLostError(PortError):
    """The port went away in an order: tell its verdict, then let this go on."""

    def __init__(self, verdict: Verdict, error: PortError) -> None:
        self.verdict = verdict
        super().__init__(str(error))


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
        self._plan = plan
        self._report = report
        self._newer_than = newer_than
        self._clock = clock

    def switch(self, command: Command, station: Station, bus: Exchanger) -> Verdict:
        """Make one write. What it changed is told; the verdict is for the caller to tell.

        Raises:
            OrderLostError: The port went away meanwhile.
        """
        before, settings = station.outputs.value, station.settings
        write = self.write([command], station, bus)
        verdict = write.run()
        self.sent = write.sent
        self.conclude([write], station, before, settings)
        return _told(verdict, write.port_error)

    def set(self, command: SettingCommand, station: Station, bus: Exchanger) -> Verdict:
        """Write one mode or hold time; otherwise as `switch`."""
        before = station.settings
        write = SettingsWrite(command, station, bus, self._clock)
        verdict = write.run()
        if verdict.status is Status.DONE:
            station.accept(command.output)
        if station.settings != before:
            self._report.settings(station)
        return _told(verdict, write.port_error)

    def write(self, commands: Sequence[Command], station: Station, bus: Exchanger) -> Write:
        """Return the write that carries out these, to be begun and ended."""
        return Write(commands, station, bus, self._clock, self._newer_than)

    def conclude(
        self,
        writes: Sequence[Write],
        station: Station,
        before: int | None,
        settings: OutputSettings | None,
    ) -> None:
        """Tell what writes changed that are judged.

        Args:
            writes: All that one read after them judged.
            station: The module.
            before: What its outputs were, as far as was known.
            settings: What its modes and hold times were.
        """
        now, asked = self._clock(), 0
        outputs = Poll(station.config.address, Kind.OUTPUTS)
        for write in writes:
            asked |= write.mask
            for hold_s in station.holds_s(write.started):
                self._plan.appoint(outputs, now + hold_s * _CLOCKS_DIFFER)
        if station.settings != settings:
            self._report.settings(station)
        if station.outputs.value != before:
            self._report.values(station)
            self._report.covers(station, now)
            self._report.unasked(station, before, asked=asked)
        judged = [one for write in writes for one in write.judged]
        for command, verdict in judged:
            station.commanded(command.mask, verdict)
        if any(verdict.reason is Reason.NO_REPLY for _, verdict in judged):
            station.unanswered_at = now
            if station.presence.online:
                station.presence.ignored(now, READ_TRIES)

    def newer_than(self, command: AnyCommand) -> bool:
        """Return whether a newer command waits that names an output of `command`."""
        return self._newer_than(command)


def _told(verdict: Verdict, lost: PortError | None) -> Verdict:
    if lost is not None:
        raise OrderLostError(verdict, lost) from lost
    return verdict
