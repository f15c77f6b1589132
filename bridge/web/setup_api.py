"""The routes of commissioning: ports, scans, blinks, the proposed configuration, traces."""

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from bridge.errors import BridgeError
from bridge.mqtt.strict_json import object_of
from bridge.transport.opener import same_port
from bridge.transport.ports import serial_ports
from bridge.web.board import Board
from bridge.web.config_file import ConfigFile
from bridge.web.door import Level
from bridge.web.guest import Guest, Route

if TYPE_CHECKING:
    from bridge.config.current import CurrentConfig
    from bridge.web.setup import Setup

_MOST_NAMES_BYTES = 64 * 1024
_MOST_DIGITS = 2
_LONGEST_TRACE_S = 600.0
StartTrace = Callable[[str, float], None]


class SetupApi:
    """Answers for commissioning. The thread of the panel calls it; `stop` and `join`: the main one.

    `current` is set before it is asked; `trace` starts or ends (0 s) a trace of a line. What a
    search needs is imported for the first request: a bridge without one holds no memory for it.
    """

    def __init__(self, board: Board, file: ConfigFile | None, trace: StartTrace) -> None:
        self.current: CurrentConfig | None = None
        self._board = board
        self._made: Setup | None = None
        self._file = file
        self._trace = trace

    @property
    def routes(self) -> tuple[Route, ...]:
        """Return its routes."""
        return (
            Route("GET", "/api/ports", Level.SWITCH, self._ports),
            Route("POST", "/api/scan", Level.SWITCH, self._scan, 4096),
            Route("POST", "/api/blink", Level.SWITCH, self._blink, 4096),
            Route("POST", "/api/proposal", Level.SWITCH, self._proposal, _MOST_NAMES_BYTES),
            Route("POST", "/api/trace", Level.SWITCH, self._trace_line, 4096),
        )

    def stop(self) -> None:
        """Ask a search that is under way to end."""
        if self._made is not None:
            self._made.stop()

    def join(self) -> None:
        """Wait until nothing is under way: an output that blinks is OFF then."""
        if self._made is not None:
            self._made.join()

    @property
    def _setup(self) -> "Setup":
        from bridge.web.setup import Setup  # noqa: PLC0415

        if self._made is None:
            self._made = Setup(self._board)
        return self._made

    async def _ports(self, _: Guest) -> Any:
        found = [
            {"port": one.path, "words": one.words, "line": self._line_at(one.path)}
            for one in serial_ports()
        ]
        return {"ports": found}

    def _line_at(self, port: str) -> str | None:
        lines = self.current.config.lines if self.current else ()
        return next((line.id for line in lines if same_port(line.port, port)), None)

    async def _scan(self, guest: Guest) -> Any:
        asked = object_of(guest.body)
        if asked.get("stop") is True:
            self._setup.stop()
            return {}
        port, thorough = asked.get("port"), asked.get("thorough", False)
        if not isinstance(port, str) or not isinstance(thorough, bool):
            return {"error": "port is a text, and thorough is true or false"}, 400
        try:
            if line := self._line_at(port):
                return {"error": f"line {line} of the configuration uses this port"}, 409
            self._setup.scan(port, thorough=thorough)
        except BridgeError as error:
            return {"error": str(error)}, 409
        return {}

    async def _blink(self, guest: Guest) -> Any:
        asked = object_of(guest.body)
        address, output = asked.get("address"), asked.get("output")
        if type(address) is not int or type(output) is not int:
            return {"error": "address and output are numbers"}, 400
        try:
            await asyncio.to_thread(self._setup.blink, address, output)
        except BridgeError as error:
            return {"error": str(error)}, 409
        return {}

    async def _proposal(self, guest: Guest) -> Any:
        if self._file is None:
            return {"error": "this bridge was started without a file"}, 404
        try:
            names = _names(object_of(guest.body).get("names", {}))
            shown = self._file.show()
            return {**shown, "text": self._setup.proposal(shown["text"], names)}
        except BridgeError as error:
            return {"error": str(error)}, 409

    async def _trace_line(self, guest: Guest) -> Any:
        asked = object_of(guest.body)
        line, for_s = asked.get("line"), asked.get("for_s", 60)
        known = [one.id for one in self.current.config.lines] if self.current else []
        if line not in known:
            return {"error": "line is one of the configuration"}, 400
        if isinstance(for_s, bool) or not isinstance(for_s, int | float):
            return {"error": "for_s is a number of seconds"}, 400
        if not 0 <= for_s <= _LONGEST_TRACE_S:
            return {"error": f"for_s is at most {_LONGEST_TRACE_S:g}"}, 400
        self._trace(str(line), float(for_s))
        return {}


def _names(given: object) -> dict[int, dict[str, Any]]:
    """Return the names of modules by their address.

    Raises:
        BridgeError: They are not written as names are.
    """
    return {_number(address): _of_module(names) for address, names in _object(given).items()}


def _of_module(given: object) -> dict[str, Any]:
    names = _object(given)
    texts: dict[str, Any] = {key: _text(names[key]) for key in ("id", "name") if key in names}
    ways: dict[str, Any] = {
        key: {_number(n): _text(name) for n, name in _object(names[key]).items()}
        for key in ("inputs", "outputs")
        if key in names
    }
    return {**texts, **ways}


def _object(given: object) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise BridgeError("names is an object: by address, an object of names")
    return given


def _number(given: str) -> int:
    if not (given.isascii() and given.isdecimal() and len(given) <= _MOST_DIGITS):
        raise BridgeError("addresses and channels are numbers")
    return int(given)


def _text(given: object) -> str:
    if not isinstance(given, str) or not given.isprintable():
        raise BridgeError("a name is a text of one line")
    return given
