"""Reports changes of a line and its modules: events for the hub, and one log line each."""

import logging
from collections.abc import Callable, Sequence

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.config.schema import LineConfig
from bridge.errors import BadReplyError, ExchangeError, RefusedError
from bridge.line.rules.strays import is_text
from bridge.line.station import Station
from bridge.model import (
    CoverChanged,
    CoverState,
    Gesture,
    GestureMade,
    InputsRose,
    LineChanged,
    LineEvent,
    LossOrderMade,
    ProblemChanged,
    Reason,
    SettingsRead,
    StationChanged,
    Status,
    ValuesChanged,
    Verdict,
    bit,
    channels_of,
)
from bridge.protocol.readings import reading_of

_log = logging.getLogger(__name__)

_MOVING_EVERY_S = 1.0


class LineReport:
    """The reports of one line worker. Only its thread uses it."""

    def __init__(
        self,
        config: LineConfig,
        emit: Callable[[LineEvent], None],
        clock: Callable[[], float],
        budgets: Budgets | None = None,
    ) -> None:
        self._config = config
        self._emit = emit
        self._bounded = BoundedLog(_log, clock, budgets)
        self._online: bool | None = None  # None: nothing was reported about the port yet

    def tick(self) -> None:
        """Log the lines that were held back."""
        self._bounded.tick()

    def up(self) -> None:
        """Report that the port is open."""
        if not self._online:
            self._online = True
            text, extra = self._of_line(f"{self._config.port} is open")
            self._bounded.end(Cause.PORT, self._config.id, text, extra, always=True)
            self._emit(LineChanged(self._config.id, online=True, detail=self._config.port))

    def down(self, detail: str) -> None:
        """Report that the port is gone, or cannot be opened."""
        if self._online is not False:
            self._online = False
            text, extra = self._of_line(detail)
            self._bounded.tell(Cause.PORT, self._config.id, logging.ERROR, text, extra)
            self._emit(LineChanged(self._config.id, online=False, detail=detail))

    def dropped(self, detail: str) -> None:
        """Log that the connection was lost, and is opened again at once."""
        self._log_line(f"{detail} (it is opened again at once)")

    def unanswered(self) -> None:
        """Log that no module answers over a gateway."""
        self._log_line(
            f"no module answers on {self._config.port}, and it is opened anew: are the modules "
            "on, is the gateway in transparent mode (raw TCP, not Modbus TCP), and its baud rate "
            "right?",
        )

    def met(self, station: Station, now: float) -> None:
        """Publish states, then `online` (docs/contract.md, Order and truth).

        `online` waits while the port is on trial.
        """
        name = station.config.id
        station.wrong_model = station.absence_logged = False
        station.told_reading = None
        self._emit(SettingsRead(name, station.settings))
        self.values(station)
        self.covers(station, now)
        self._tell_difference(station)
        if self._online:
            self.online(station)

    def online(self, station: Station) -> None:
        """Report that a module is online."""
        if not station.told_online:
            station.told_online = True
            text = f"online: {station.config.model.name}"
            self._end_station(Cause.STATION, station, text, always=True)
            self._emit(StationChanged(station.config.id, online=True, detail=""))

    def settings(self, station: Station) -> None:
        """Report changed modes or hold times."""
        self._emit(SettingsRead(station.config.id, station.settings))
        if station.differing_settings() != station.told_difference:
            self._tell_difference(station)

    def exchanged(self, station: Station, complaint: str) -> None:
        """Report that another module answers in place of one that was online."""
        text = f"exchanged while it was online: {complaint}"
        self._log_station(logging.WARNING, station, text, Cause.STATION)
        self.gone(station, complaint)

    def wrong_model(self, station: Station, complaint: str) -> None:
        """Report that another model than configured answers."""
        if not station.wrong_model:
            station.wrong_model = True
            text = f"wrong model: {complaint}"
            self._log_station(logging.ERROR, station, text, Cause.STATION)
            self._emit(ProblemChanged(station.config.id, Reason.WRONG_MODEL.value, complaint))

    def values(self, station: Station) -> None:
        """Report the channels of a module."""
        if station.inputs.value is not None and station.outputs.value is not None:
            self._emit(
                ValuesChanged(station.config.id, station.inputs.value, station.outputs.value)
            )
            self._tell_clash(station, station.outputs.value)

    def edges(self, station: Station, before: int | None) -> None:
        """Report counted inputs that went ON since `before`; the first value is not an edge."""
        after = station.inputs.value
        if before is None or after is None:
            return
        rose = after & ~before & station.counted
        if rose:
            self._emit(InputsRose(station.config.id, rose))

    def gestures(self, station: Station, now: float) -> Sequence[tuple[int, Gesture]]:
        """Report the presses that the inputs, read at `now`, complete; return them."""
        if station.buttons is None or station.inputs.value is None:
            return ()
        made = station.buttons.observe(station.inputs.value, now)
        for channel, gesture in made:
            self._emit(GestureMade(station.config.id, channel, gesture))
        return made

    def covers(self, station: Station, now: float) -> None:
        """Report changes of covers at once, and positions of moving covers once a second."""
        for name, motion in station.covers.items():
            state, position = motion.shown(now)
            told = station.told_covers.get(name)
            if told is not None and told[0] is state:
                moves = state in {CoverState.OPENING, CoverState.CLOSING}
                if told[1] == position or (moves and now < told[2] + _MOVING_EVERY_S):
                    continue
            station.told_covers[name] = (state, position, now)
            self._emit(CoverChanged(station.config.id, name, state, position))

    def cover_unasked(self, station: Station, cover: str, longest_s: float) -> None:
        """Log that a cover moves without an order from here."""
        text = f"cover {cover} moves unasked: it is stopped within {longest_s:.1f} s"
        self._log_station(logging.WARNING, station, text, Cause.UNASKED, f"cover {cover}")

    def cover_left(self, station: Station, cover: str) -> None:
        """Log at the end of the line that a motor was not confirmed OFF."""
        text = f"cover {cover} may still move: its module could not be told to stop"
        self._log_station(logging.ERROR, station, text, Cause.MOTOR, f"cover {cover}")

    def gone(self, station: Station, detail: str) -> None:
        """Report that a module that was online is offline."""
        if station.told_online:
            station.told_online = False
            self._emit(StationChanged(station.config.id, online=False, detail=detail))

    def absent(self, station: Station, error: ExchangeError) -> None:
        """Report once that a module gives no valid answer, however long it stays away."""
        reading = reading_of(error)
        if station.absence_logged and reading in {None, station.told_reading}:
            return
        station.absence_logged, station.told_reading = True, reading
        detail = str(error)
        if reading is not None:
            detail += f" (reading {reading} of docs/protocol.md: `wisco2mqtt verify` tells more)"
        elif isinstance(error, BadReplyError):  # it sends bytes that are no valid reply
            detail += f"; two modules may share address {station.config.address}, or noise"
        self._log_station(logging.WARNING, station, f"offline: {detail}", Cause.STATION)
        if not station.wrong_model:  # else the wrong model stays the problem
            refused = isinstance(error, RefusedError)
            reason = Reason.MODULE_REFUSED if refused else Reason.NO_REPLY
            self._emit(ProblemChanged(station.config.id, reason.value, detail))

    def loss_order(self, station: Station, output: int) -> None:
        """Report that the order of `on_loss` for an output is done in this loss."""
        self._emit(LossOrderMade(station.config.id, output))

    def own_order(self, station: Station, verdict: Verdict) -> None:
        """Report an order of the configuration (`verdict.by`) that was done or failed."""
        what = f"{verdict.target} {verdict.payload} by {verdict.by} ({verdict.detail})"
        done = verdict.status is Status.DONE
        outcome = "done" if done else f"{verdict.status}: {verdict.reason}"
        level = logging.INFO if done else logging.WARNING
        text = f"{what}: {outcome}"
        self._log_station(level, station, text, Cause.OWN_ORDER, f"{verdict.target} {verdict.by}")
        self._emit(verdict)

    def strays(self, count: int, evidence: bytes) -> None:
        """Log unsolicited bytes (docs/failures.md A14)."""
        cause = f"another master on this line? (heard: {evidence.hex(' ')})"
        if "://" in self._config.port and is_text(evidence):
            cause = (
                "text from the gateway: registration or heartbeat packets are on; switch them off "
                f"there (heard: {evidence.decode('ascii')!r})"
            )
        text, extra = self._of_line(f"{{amount}} bytes that were not requested: {cause}")
        subject = self._config.id
        self._bounded.tell(Cause.STRAYS, subject, logging.WARNING, text, extra, amount=count)

    def unasked(self, station: Station, before: int | None, asked: int = 0) -> bool:
        """Log outputs that changed without an order; return whether there are any.

        `asked` are the outputs with an order. See docs/failures.md A7.
        """
        after = station.outputs.value
        if before is None or after is None:
            return False
        outputs = station.unasked(before, after) & ~asked
        if not outputs:
            return False
        words = (f"output {n} changed unasked to {_word(after, n)}" for n in channels_of(outputs))
        self._log_station(logging.WARNING, station, ", ".join(words), Cause.UNASKED)
        return True

    def _tell_clash(self, station: Station, outputs: int) -> None:
        """Report interlocked outputs that are ON together: the bridge does not switch them."""
        clash = station.interlock.clashes(outputs)
        if clash is not None and clash != station.told_clash:
            self._log_station(logging.WARNING, station, clash, Cause.UNASKED, "interlock")
        station.told_clash = clash

    def _tell_difference(self, station: Station) -> None:
        difference = station.told_difference = station.differing_settings()
        if difference is not None:
            self._log_station(logging.WARNING, station, difference, Cause.SETTINGS)
        else:
            self._end_station(Cause.SETTINGS, station, "settings are as declared again")
        reason = "settings_differ" if difference else None
        self._emit(ProblemChanged(station.config.id, reason, difference or ""))

    def _log_line(self, text: str) -> None:
        text, extra = self._of_line(text)
        self._bounded.tell(Cause.PORT, f"{self._config.id} gateway", logging.WARNING, text, extra)

    def _log_station(
        self, level: int, station: Station, text: str, cause: Cause, what: str = ""
    ) -> None:
        """Log a text about a station; `what` separates subjects of one cause at one station."""
        text, extra = self._of_station(station, text)
        subject = f"{station.config.id} {what}"
        self._bounded.tell(cause, subject, level, text, extra)

    def _end_station(
        self, cause: Cause, station: Station, text: str, *, always: bool = False
    ) -> None:
        text, extra = self._of_station(station, text)
        self._bounded.end(cause, f"{station.config.id} ", text, extra, always=always)

    def _of_line(self, text: str) -> tuple[str, dict[str, str]]:
        return f"line {self._config.id}: {text}", {"line": self._config.id}

    def _of_station(self, station: Station, text: str) -> tuple[str, dict[str, str]]:
        line, name = self._config.id, station.config.id
        where = f"line {line} station {station.config.address} ({name})"
        return f"{where}: {text}", {"line": line, "station": name}


def _word(outputs: int, channel: int) -> str:
    return "ON" if outputs & bit(channel) else "OFF"
