"""The hub: reports from lines go to the publisher, commands go to lines.

Only the main thread uses it.
"""

from collections.abc import Callable, Iterable, Mapping

from bridge.config.current import CurrentConfig
from bridge.config.schema import LineConfig
from bridge.hub.admission import StationGate
from bridge.hub.counts import Counts
from bridge.hub.line_set import Worker
from bridge.hub.memory import Memory
from bridge.hub.rules import HouseRules
from bridge.model import (
    AnyCommand,
    Command,
    InputsRose,
    LineChanged,
    LineEvent,
    LossOrderMade,
    ProblemChanged,
    Publish,
    Reason,
    RuleDue,
    SettingsRead,
    StateEvent,
    StationChanged,
    Status,
    Word,
    verdict_on,
)


class Hub:
    """Connects lines and publisher.

    `lines` may change during a reload: a line that is missing takes no commands at that moment.

    Attributes:
        rules: The rules of the house.
    """

    def __init__(
        self,
        current: CurrentConfig,
        publish: Publish,
        lines: Mapping[str, Worker],
        counts: Counts,
        clock: Callable[[], float],
        *,
        memory: Memory | None = None,
    ) -> None:
        self._current = current
        self._counts = counts
        self._publish = publish
        self._lines = lines
        self._clock = clock
        self._gates: dict[str, StationGate] = {}
        self._memory = memory or Memory()
        self.rules = HouseRules(current, publish, lines, self.submit, self._memory)

    def config_replaced(self, ended: Iterable[LineConfig]) -> None:
        """Take the lines that `ended` off the air: all that they told was applied."""
        self._counts.publish_all()
        for line in ended:
            for config in line.stations:
                self._gates.pop(config.id, None)
                gone = StationChanged(config.id, online=False, detail="")
                self.rules.note(gone)
                self._publish(gone)
            self._publish(LineChanged(line.id, online=False, detail=""))

    def apply(self, event: LineEvent) -> None:
        """Handle one event of a line, in the order in which the line sent them."""
        match event:
            case LossOrderMade(station_id, output):
                self._memory.loss.carried_out(station_id, output)
            case InputsRose(station_id, channels):
                self._counts.rose(station_id, channels)
            case RuleDue():
                self.rules.due(event)
            case _:
                self._note(event)
                self.rules.note(event)
                self._publish(event)

    def _note(self, event: StateEvent) -> None:
        """Keep what decides whether a command is let through."""
        match event:
            case StationChanged(station_id, online):
                self._gate(station_id).online = online
            case SettingsRead(station_id, settings):
                self._gate(station_id).read_pulse(settings.pulse if settings else None)
            case ProblemChanged(station_id, reason):
                self._gate(station_id).wrong_model = reason == Reason.WRONG_MODEL

    def submit(self, command: AnyCommand) -> None:
        """Pass a command to its line, or refuse it with a verdict."""
        now = self._clock()
        reason = self._objection(command, now)
        if reason is None:
            self._lines[self._current.line_of[command.station_id]].submit(command)
        else:
            advice = self._gate(command.station_id).advice(command, reason)
            self._publish(verdict_on(command, now, Status.REFUSED, reason, detail=advice))

    def _gate(self, station_id: str) -> StationGate:
        if station_id not in self._gates:
            self._gates[station_id] = StationGate(self._current.stations[station_id], self._clock())
        return self._gates[station_id]

    def _objection(self, command: AnyCommand, now: float) -> Reason | None:
        # A duplicate id is refused whatever the verdict on the first command was.
        if command.id is not None and self._memory.seen_ids.is_repeat(command.id, now):
            return Reason.DUPLICATE
        if self._current.line_of[command.station_id] not in self._lines:
            return Reason.STOPPING
        gate = self._gate(command.station_id)
        word = command.word if isinstance(command, Command) else None
        if word is Word.PRESS and not command.mask & gate.pressable:
            return Reason.BAD_PAYLOAD
        if word is Word.TOGGLE and command.mask & gate.pulse:
            return Reason.BAD_PAYLOAD
        return gate.objection(command, now)
