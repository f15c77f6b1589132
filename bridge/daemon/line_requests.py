"""What the bridge does on a line between its polls when asked to: `scan`, `eeprom`, `verify`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from bridge.config.current import CurrentConfig
from bridge.config.schema import Config, LineConfig, StationConfig
from bridge.hub.line_set import Worker
from bridge.line.errand import EndErrand, Errand, ErrandTold, SharedLine, Tell
from bridge.model import LineProtocol
from bridge.mqtt.requests import BridgeRequest, RequestDesk, only
from bridge.mqtt.strict_json import bad

_PROGRESS_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class _Running:
    """The errand of a line."""

    id: int
    request: BridgeRequest
    told_at: float


class ErrandDesk:
    """Hands errands to lines, one a line at a time, and answers. Only the main thread calls it.

    `lines` may change under our eyes: who is not in it takes no errands just now. `tell` is called
    in the threads of lines, and brings what it is given back here, to `told`. `line_work` is
    imported for a request alone: a bridge without one holds no memory for it.
    """

    def __init__(
        self,
        current: CurrentConfig,
        lines: Mapping[str, Worker],
        desk: RequestDesk,
        tell: Callable[[ErrandTold], None],
        clock: Callable[[], float],
    ) -> None:
        self._current = current
        self._lines = lines
        self._desk = desk
        self._tell = tell
        self._clock = clock
        self._last_id = 0
        self._running: dict[str, _Running] = {}

    def open(self) -> None:
        """Register its requests."""
        self._desk.serve("scan", self._scan)
        self._desk.serve("eeprom", self._eeprom)
        self._desk.serve("verify", self._verify)

    def told(self, event: ErrandTold) -> None:
        """Handle a report of an errand: the answer, or its progress once a second."""
        running = self._running.get(event.line)
        if running is None or running.id != event.id:
            return
        if event.ended:
            del self._running[event.line]
            if event.error is None:
                self._desk.answer(running.request, {**event.data, "final": True})
            else:
                self._desk.refuse(running.request, event.error)
        elif self._clock() - running.told_at >= _PROGRESS_EVERY_S:
            self._running[event.line] = replace(running, told_at=self._clock())
            self._desk.progress(running.request, {**event.data, "final": False})

    # --- requests -----------------------------------------------------------------------------

    def _scan(self, request: BridgeRequest) -> Mapping[str, Any] | None:
        only(request, "line", "stations", "thorough", "stop")
        line = line_of(request, self._current.config)
        if request.arguments.get("stop") is True:
            return self._stop(request, line)
        thorough = request.arguments.get("thorough", False)
        if not isinstance(thorough, bool):
            raise bad("thorough is neither true nor false")
        from bridge.daemon.line_work import scan_of  # noqa: PLC0415

        scan = scan_of(line, request.arguments.get("stations"), thorough=thorough)
        self._send(request, line, scan.run)
        return None

    def _eeprom(self, request: BridgeRequest) -> Mapping[str, Any] | None:
        only(request, "station", "stop")
        line, config = _station_of(request, self._current.config)
        if request.arguments.get("stop") is True:
            return self._stop(request, line)
        if line.protocol is LineProtocol.MODBUS_RTU:
            raise bad("the EEPROM is reached in Wisco frames alone, and a modbus-rtu line has none")
        from bridge.daemon.line_work import dump  # noqa: PLC0415

        self._send(request, line, lambda shared, tell: dump(line, config, shared, tell))
        return None

    def _verify(self, request: BridgeRequest) -> Mapping[str, Any] | None:
        only(request, "line", "stations", "samples", "stop")
        line = line_of(request, self._current.config)
        if request.arguments.get("stop") is True:
            return self._stop(request, line)
        from bridge.daemon.line_work import verification_of  # noqa: PLC0415

        asked = request.arguments
        work = verification_of(line, asked.get("stations"), asked.get("samples"))
        self._send(request, line, work.run)
        return None

    def _stop(self, request: BridgeRequest, line: LineConfig) -> Mapping[str, Any]:
        """End the errand in progress: its own client gets an error."""
        running, worker = self._running.get(line.id), self._lines.get(line.id)
        if running is None or running.request.verb != request.verb or worker is None:
            raise bad(f"no {request.verb} is under way on line {line.id}")
        worker.ask(EndErrand(running.id))
        return {"line": line.id, "final": True}

    def _send(
        self,
        request: BridgeRequest,
        line: LineConfig,
        work: Callable[[SharedLine, Tell], Mapping[str, Any]],
    ) -> None:
        worker = self._lines.get(line.id)
        if worker is None:
            raise bad(f"line {line.id} is just being exchanged: ask again")
        if busy := self._running.get(line.id):
            raise bad(f"line {line.id} is busy with another {busy.request.verb}: wait for its end")
        self._last_id += 1
        # The first report comes at once: the client then knows that the work has begun.
        self._running[line.id] = _Running(self._last_id, request, self._clock() - _PROGRESS_EVERY_S)
        worker.ask(Errand(line.id, self._last_id, work, self._tell))


def line_of(request: BridgeRequest, config: Config) -> LineConfig:
    """Return the line that a request names.

    Raises:
        CommandError: It names none, or an unknown one.
    """
    lines = {line.id: line for line in config.lines}
    name = request.arguments.get("line")
    if not isinstance(name, str) or name not in lines:
        raise bad(f"line is to name one of {', '.join(lines)}")
    return lines[name]


def _station_of(request: BridgeRequest, config: Config) -> tuple[LineConfig, StationConfig]:
    name = request.arguments.get("station")
    for line, station_config in config.all_stations:
        if station_config.id == name:
            return line, station_config
    raise bad("station is to name one of the configuration")
