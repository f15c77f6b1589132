"""Switches one output of a module ON for a moment, so that a person sees which module it is."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from bridge.clock import boot_s
from bridge.commission.visit import meet, plain_station
from bridge.config.schema import LineConfig
from bridge.errors import BridgeError
from bridge.line.actions.writes import Write
from bridge.line.station import Station
from bridge.model import Command, ModuleType, Status, Verdict, Word, bit
from bridge.transport.bus import Bus
from bridge.transport.port import Port
from bridge.transport.timing import LineTiming

BLINK_S = 0.5
_PATIENCE_S = 2.0
_TRIES_OFF = 5


@dataclass(frozen=True, slots=True)
class Blink:
    """One output of one module, on a line that nothing else uses.

    `pause` waits; it returns early where the bridge is being stopped.
    """

    line: LineConfig
    address: int
    model: ModuleType
    output: int
    pause: Callable[[float], object] = time.sleep

    def run(self, port: Port) -> None:
        """Blink once; a pulse output gets one pulse of its own.

        Raises:
            BridgeError: It was not done; the message says whether the output may be ON.
        """
        bus = Bus(port, LineTiming.from_config(self.line), self.line.late_window_s)
        bus.await_silence()
        station = Station(plain_station(self.address, self.model), self.line)
        meet(station, self.line, bus, boot_s)
        if (station.outputs.value or 0) & bit(self.output):
            raise BridgeError(f"output {self.output} is ON already: it is left as it is")
        if station.settings is not None and station.settings.pulse & bit(self.output):
            self._say(self._write(station, bus, Word.PRESS))
            return
        verdict = self._write(station, bus, Word.ON)
        self.pause(BLINK_S)
        self._switch_off(station, bus)
        self._say(verdict)

    def _switch_off(self, station: Station, bus: Bus) -> None:
        for _ in range(_TRIES_OFF):
            if self._write(station, bus, Word.OFF).status is Status.DONE:
                return
        raise BridgeError(f"output {self.output} may still be ON: it was not read OFF")

    def _write(self, station: Station, bus: Bus, word: Word) -> Verdict:
        now, mask = boot_s(), bit(self.output)
        command = Command(
            station.config.id,
            f"do/{self.output}",
            word.value,
            mask,
            0 if word is Word.OFF else mask,
            Word.PRESS if word is Word.PRESS else None,
            arrived=now,
            deadline=now + _PATIENCE_S,
        )
        return Write([command], station, bus, boot_s, lambda _: False).run()

    def _say(self, verdict: Verdict) -> None:
        if verdict.status is not Status.DONE:
            raise BridgeError(f"output {self.output}: {verdict.status}, {verdict.reason}")
