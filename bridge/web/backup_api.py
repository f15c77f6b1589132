"""The routes of a backup of the cabinet: what `wisco2mqtt backup` saves, while the bridge runs."""

import asyncio
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any

from bridge import __version__
from bridge.errors import BridgeError
from bridge.model import LineProtocol, OutputSettings, bits_of
from bridge.web.board import BACKUP_KEY, Board
from bridge.web.config_file import ConfigFile
from bridge.web.door import Level
from bridge.web.guest import Guest, Route, call_in

if TYPE_CHECKING:
    from bridge.commission.cabinet import KeptModule
    from bridge.config.current import CurrentConfig
    from bridge.config.schema import LineConfig, StationConfig
    from bridge.mqtt.requests import Reply

AskBridge = Callable[[str, Mapping[str, Any], "Reply"], None]


class BackupApi:
    """Makes a backup at a time, and keeps the last one. The thread of the panel calls it.

    `current` is set before it is asked; `ask` makes a request to the bridge. The EEPROM of a module
    is read between polls, as by the request `eeprom`; modes, hold times and counts are known. What
    an archive needs is imported for the first: a bridge without one holds no memory for it.
    """

    def __init__(
        self,
        board: Board,
        file: ConfigFile | None,
        ask: AskBridge,
        wall_clock: Callable[[], datetime],
    ) -> None:
        self.current: CurrentConfig | None = None
        self._board = board
        self._file = file
        self._ask = ask
        self._wall_clock = wall_clock
        self._work: asyncio.Task[None] | None = None
        self._archive = b""
        self._told: dict[str, Any] = {}

    @property
    def routes(self) -> tuple[Route, ...]:
        """Return its routes."""
        return (
            Route("POST", "/api/backup", Level.SWITCH, self._start, 16),
            Route("GET", "/api/backup", Level.SWITCH, self._download),
        )

    async def _start(self, _: Guest) -> Any:
        if self._file is None or self.current is None:
            return {"error": "this bridge was started without a file"}, 404
        if self._work is not None and not self._work.done():
            return {"error": "a backup is being made: wait for its end"}, 409
        self._archive = b""
        self._told = {"running": True, "share": 0.0, "left_out": [], "error": None}
        self._tell()
        stations = tuple(self.current.config.all_stations)
        self._work = asyncio.create_task(self._make(self._file, stations))
        return {}

    async def _download(self, _: Guest) -> Any:
        if not self._archive:
            return {"error": "there is no backup yet: make one"}, 409
        name = f"wisco2mqtt-{self._wall_clock():%Y-%m-%d}.zip"
        headers = {
            "Content-Type": "application/zip",
            "Content-Disposition": f'attachment; filename="{name}"',
        }
        return self._archive, 200, headers

    async def _make(
        self, file: ConfigFile, stations: "tuple[tuple[LineConfig, StationConfig], ...]"
    ) -> None:
        from bridge.commission.cabinet import Cabinet, packed  # noqa: PLC0415
        from bridge.hub.count_file import counts_text  # noqa: PLC0415

        try:
            kept = []
            for number, (line, config) in enumerate(stations):
                kept += await self._kept(line, config)
                self._told["share"] = round((number + 1) / len(stations), 3)
                self._tell()
            shown = await asyncio.to_thread(file.show)
            cabinet = Cabinet(
                made=self._wall_clock().isoformat(timespec="seconds"),
                version=__version__,
                config=shown["text"].encode(),
                counts=counts_text(counts) if (counts := self._counts()) else None,
                modules=tuple(kept),
            )
            self._archive = await asyncio.to_thread(packed, cabinet)
        except BridgeError as error:
            self._told["error"] = str(error)
        finally:
            self._told["running"] = False
            self._tell()

    async def _kept(self, line: "LineConfig", config: "StationConfig") -> "list[KeptModule]":
        """Return what a module holds; none: it does not answer, which is told."""
        from bridge.commission.cabinet import KeptModule  # noqa: PLC0415
        from bridge.commission.settings_file import format_settings  # noqa: PLC0415

        known = self._stations().get(config.id, {})
        image = None
        if not known.get("online"):
            self._leave_out(f"{config.id}: it is offline")
            return []
        if line.protocol is not LineProtocol.MODBUS_RTU:
            answer = await self._eeprom(config.id)
            if answer["status"] != "ok":
                self._leave_out(f"{config.id}: {answer['error']}")
                return []
            image = answer["data"]["image"]
        settings = _settings(known["settings"])
        if settings is None:
            if config.address:  # in Modbus, 0 is no station
                self._leave_out(f"modes and hold times of {config.id}: they are not known")
            return [KeptModule(config.id, config.model, None, image)]
        text = format_settings(config.id, config.model, settings)
        return [KeptModule(config.id, config.model, text, image)]

    async def _eeprom(self, station_id: str) -> Mapping[str, Any]:
        """Return the last answer to the request; what comes before it is progress."""
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[Mapping[str, Any]] = loop.create_future()

        def settle(answer: Mapping[str, Any]) -> None:
            if not answered.done():
                answered.set_result(answer)

        def reply(answer: Mapping[str, Any]) -> None:
            if answer["data"].get("final", True):
                call_in(loop, settle, answer)

        self._ask("eeprom", {"station": station_id}, reply)
        return await answered

    def _counts(self) -> dict[tuple[str, int], int]:
        return {
            (station_id, int(channel)): edges
            for station_id, known in self._stations().items()
            for channel, edges in known["counts"].items()
        }

    def _stations(self) -> dict[str, Mapping[str, Any]]:
        """Return what the panel knows of each station, now."""
        return {
            entry.key.removeprefix("station/"): entry.document
            for entry in self._board.since(0).state
            if entry.key.startswith("station/")
        }

    def _leave_out(self, what: str) -> None:
        self._told["left_out"] = [*self._told["left_out"], what]

    def _tell(self) -> None:
        self._board.put(BACKUP_KEY, {**self._told, "ready": bool(self._archive)})


def _settings(known: Mapping[str, Any] | None) -> OutputSettings | None:
    if known is None:
        return None
    hold_ds = tuple(round(hold_s * 10) for hold_s in known["hold"])
    return OutputSettings(bits_of(known["pulse"]), hold_ds)
