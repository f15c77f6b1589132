"""The routes of the configuration: show it, check a text, save one."""

import asyncio
from collections.abc import Callable
from typing import Any

from bridge.errors import ConfigError
from bridge.mqtt.strict_json import object_of
from bridge.web.config_file import ConfigFile, StaleFileError, problems_of
from bridge.web.door import Level
from bridge.web.guest import Guest, Route

MOST_TEXT_BYTES = 256 * 1024
_RELOAD_AFTER_S = 0.2  # so that the answer is sent first: the panel itself may be started anew


class ConfigApi:
    """Answers for the configuration. Only the thread of the panel calls it."""

    def __init__(self, file: ConfigFile | None, reload: Callable[[], None]) -> None:
        """Args: `reload` asks the bridge to read the file again; any thread may call it."""
        self._file = file
        self._reload = reload
        self._busy = asyncio.Lock()  # one text is parsed at a time, whoever asks

    @property
    def routes(self) -> tuple[Route, ...]:
        """Return its routes."""
        return (
            Route("GET", "/api/config", Level.SWITCH, self._show),
            Route("PUT", "/api/config", Level.SWITCH, self._save, MOST_TEXT_BYTES),
            Route("POST", "/api/check", Level.SWITCH, self._check, MOST_TEXT_BYTES),
        )

    async def _show(self, _: Guest) -> Any:
        return await self._at_file(lambda file: file.show())

    async def _check(self, guest: Guest) -> Any:
        text = object_of(guest.body).get("text")
        if not isinstance(text, str):
            return {"error": "text is the whole configuration"}, 400
        return await self._at_file(lambda file: file.check(text))

    async def _save(self, guest: Guest) -> Any:
        document = object_of(guest.body)
        text, version = document.get("text"), document.get("version")
        if not isinstance(text, str) or not isinstance(version, str):
            return {
                "error": "text is the whole configuration, and version the one it was made of"
            }, 400
        answer = await self._at_file(lambda file: file.save(text, version))
        if isinstance(answer, dict):
            asyncio.get_running_loop().call_later(_RELOAD_AFTER_S, self._reload)
        return answer

    async def _at_file(self, work: Callable[[ConfigFile], dict[str, Any]]) -> Any:
        """Work at the file in a thread of its own: browsers are served meanwhile."""
        file = self._file
        if file is None:
            return {"error": "this bridge was started without a file"}, 404
        async with self._busy:
            try:
                return await asyncio.to_thread(work, file)
            except ConfigError as error:
                return {"error": "the text is not valid", "problems": problems_of(error)}, 422
            except StaleFileError as error:
                return {"error": str(error)}, 409
            except OSError as error:
                return {"error": f"the file cannot be written: {error.strerror}"}, 500
