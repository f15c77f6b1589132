"""Finds modules on a port that no line uses, blinks their outputs, and proposes a configuration."""

import contextlib
import os
import threading
from collections.abc import Callable, Mapping
from typing import Any

from bridge.commission.blink import Blink
from bridge.commission.findings import Finding, Findings, Found
from bridge.commission.proposal import line_section
from bridge.commission.scan import Scan, ScanStep
from bridge.commission.survey import (
    BAUDS,
    PROTOCOLS,
    QUICK_PROTOCOLS,
    STATIONS,
    effort_at,
    survey_of,
)
from bridge.config.add_line import with_line
from bridge.config.schema import LineConfig
from bridge.errors import BridgeError
from bridge.model import channels_of
from bridge.transport.opener import open_port
from bridge.transport.port import Port
from bridge.web.board import SCAN_KEY, Board

_STOP_S = 2.0
OpenPort = Callable[[str, int], Port]


class SetupEndedError(BridgeError):
    """The scan is not wanted any more."""


class Setup:
    """One scan or blink at a time, in a thread of its own. Any thread may call it.

    Its progress is a state of the board.
    """

    def __init__(self, board: Board, open_port: OpenPort = open_port) -> None:
        self._board = board
        self._open_port = open_port
        self._busy = threading.Lock()
        self._ended = threading.Event()
        self._findings = Findings()
        self._port = ""
        self._told: dict[str, Any] = {}

    def scan(self, port: str, *, thorough: bool) -> None:
        """Start a scan.

        Raises:
            BridgeError: The port cannot be one, or another scan is under way.
        """
        check_port(port)
        if not self._busy.acquire(blocking=False):
            raise BridgeError("another search is under way: stop it, or wait for its end")
        self._ended.clear()
        self._port, self._findings = port, Findings()
        work = threading.Thread(target=self._scan, args=(thorough,), name="scan", daemon=True)
        work.start()

    def stop(self) -> None:
        """Ask what is under way to end."""
        self._ended.set()

    def join(self) -> None:
        """Wait until nothing is under way: an output that blinks is OFF then."""
        self.stop()
        self._busy.acquire(timeout=_STOP_S)

    def blink(self, address: int, output: int) -> None:
        """Blink an output of a module that was found. Takes a second or two.

        Raises:
            BridgeError: It was not done; the message says why.
        """
        found = next((one for one in self._findings.found if one.address == address), None)
        if found is None or not 1 <= output <= found.model.outputs:
            raise BridgeError("no such output was found: search first")
        if not self._busy.acquire(blocking=False):
            raise BridgeError("a search is under way: stop it first")
        try:
            self._ended.clear()
            line = LineConfig("found", self._port, found.baud, found.protocol, ())
            with contextlib.closing(self._open_port(line.port, line.baud)) as port:
                Blink(line, address, found.model, output, self._ended.wait).run(port)
        finally:
            self._busy.release()

    def proposal(self, text: str, names: Mapping[int, Mapping[str, Any]]) -> str:
        """Return the text of a configuration with what was found added to it.

        Raises:
            BridgeError: Nothing was found, or it cannot be added to this text.
        """
        findings = self._findings
        if not findings.found:
            raise BridgeError("nothing was found: search first")

        def section(line_id: str) -> list[str]:
            found, clashes = findings.found, findings.clashes
            return line_section(self._port, found, clashes, names=names, line_id=line_id)

        return with_line(text, section)

    # --- in the thread of a scan --------------------------------------------------------------

    def _scan(self, thorough: bool) -> None:  # a thread passes no names
        port = self._port
        self._told = {"port": port, "running": True, "share": 0.0, "step": None, "error": None}
        bauds = BAUDS[:1] if port.startswith("tcp://") else BAUDS
        protocols = PROTOCOLS if thorough else QUICK_PROTOCOLS
        survey = survey_of(bauds, protocols, STATIONS, effort_at(port, thorough=thorough))
        scan = Scan(survey, lambda baud: self._open_port(port, baud), self._hear)
        self._findings = scan.findings
        try:
            scan.run()
            self._told["share"] = 1.0
        except SetupEndedError:
            pass
        except BridgeError as error:
            self._told["error"] = str(error)
        finally:
            self._told |= {"running": False, "took_s": round(scan.took_s, 1)}
            self._tell()
            self._busy.release()

    def _hear(self, event: ScanStep | Finding) -> None:
        if self._ended.is_set():
            raise SetupEndedError("the search was stopped")
        if isinstance(event, ScanStep):
            sweep = event.sweep
            step = {"baud": sweep.baud, "protocol": sweep.protocol, "address": event.address}
            share = round(1 - event.left_s / event.total_s, 3)
            self._told |= {"step": step, "share": share, "left_s": round(event.left_s, 1)}
        self._tell()

    def _tell(self) -> None:
        found = sorted(self._findings.found, key=lambda one: one.address)
        clashes = sorted({one.address for one in self._findings.clashes})
        more = {"found": [_document(one) for one in found], "clashes": clashes}
        self._board.put(SCAN_KEY, {**self._told, **more})


def check_port(port: str) -> None:
    """Raise BridgeError for what is no device of this machine and no gateway."""
    is_device = os.path.realpath(port).startswith("/dev/")
    if not is_device and not port.startswith(("tcp://", "rfc2217://")):
        raise BridgeError("a port is a device below /dev, tcp://host:port or rfc2217://host:port")


def _document(one: Found) -> dict[str, Any]:
    settings = one.settings
    return {
        "address": one.address,
        "model": one.model.name,
        "inputs": one.model.inputs,
        "outputs": one.model.outputs,
        "baud": one.baud,
        "protocol": one.protocol,
        "dip": one.switches,
        "pulse": [] if settings is None else list(channels_of(settings.pulse)),
    }
