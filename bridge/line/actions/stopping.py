"""Stops the motors of a line that ends: at a stop of the bridge, or at a reload.

`bridge.line.rules.halt` decides the order, and when to give up.
"""

from collections.abc import Callable, Container, Mapping

from bridge.errors import ExchangeError, RefusedError
from bridge.line.actions.covers import Covers
from bridge.line.actions.polling import Polling
from bridge.line.measured_bus import MeasuredBus
from bridge.line.plan.streams import Poll
from bridge.line.report import LineReport
from bridge.line.rules.halt import REOPEN_S, Act, Halt, Moving, Pause, Step, off_masks
from bridge.line.rules.presence import Kind
from bridge.line.station import Station


class LineStop:
    """The end of one line worker. Only its thread uses it."""

    def __init__(
        self,
        stations: Mapping[int, Station],
        covers: Covers,
        *,
        polling: Polling,
        report: LineReport,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self._stations = stations
        self._covers = covers
        self._polling = polling
        self._report = report
        self._clock = clock
        self._sleep = sleep
        self._halt: Halt | None = None  # None: the line is not ending

    @property
    def has_begun(self) -> bool:
        """Return whether the stop has begun: only running motors count now."""
        return self._halt is not None

    @property
    def goes_on(self) -> bool:
        """Return whether a motor may run, and there is time to try again."""
        halt = self._begun()
        return halt.next(self._moving(silent=self._stations), self._clock()) is not None

    def begin(self, asked_at: float) -> None:
        """Begin the stop, if it has not begun; its time counts from `asked_at`."""
        if self._halt is None:
            self._halt = Halt(asked_at)

    def work(self, bus: MeasuredBus) -> None:
        """Switch motors OFF until none runs, or the time is over. Raises PortError."""
        halt = self._begun()
        while (step := halt.next(self._moving(bus.silent), self._clock())) is not None:
            if isinstance(step, Pause):
                self._sleep(max(0.0, step.until - self._clock()))
            else:
                self._take(step, halt, bus)

    def port_lost(self) -> None:
        """Record a lost port: it is opened again soon, and each module is contacted again."""
        self._begun().port_lost()
        self._sleep(REOPEN_S)

    # --- one step -----------------------------------------------------------------------------

    def _take(self, step: Step, halt: Halt, bus: MeasuredBus) -> None:
        station = self._stations[step.address]
        try:
            match step.act:
                case Act.MEET:
                    self._meet(station, halt, bus)
                case Act.OFF:
                    self._switch_off(station, bus)
                    halt.told(step.address)
                case Act.LOOK:
                    self._look(station, halt, bus)
        except ExchangeError:
            halt.failed(step.address, self._clock())

    def _meet(self, station: Station, halt: Halt, bus: MeasuredBus) -> None:
        address = station.config.address
        self._polling.poll(bus, Poll(address, Kind.CONTACT))
        if station.presence.online:
            halt.met(address)
        else:
            halt.failed(address, self._clock())

    def _switch_off(self, station: Station, bus: MeasuredBus) -> None:
        running = self._covers.running()[station.config.address]
        ours = station.config.cover_outputs if station.writer.protected else running
        refusal: RefusedError | None = None
        for mask in off_masks(running, ours):
            try:
                self._write_off(mask, station, bus)
            except RefusedError as error:
                refusal = error  # continue with the other modules
        if refusal is not None:
            raise refusal

    def _write_off(self, mask: int, station: Station, bus: MeasuredBus) -> None:
        writer, sent_before = station.writer, bus.sent_at
        request = writer.write_outputs(mask, 0, 0)  # no other output lies between
        try:
            bus.exchange(request, protected=writer.protected)
        finally:
            if bus.sent_at != sent_before:
                station.ordered(mask, 0, bus.sent_at)

    def _look(self, station: Station, halt: Halt, bus: MeasuredBus) -> None:
        """Read the outputs; with unprotected frames two equal replies in a row count."""
        driver = station.writer
        value = bus.exchange(driver.read_outputs, protected=driver.protected)
        if not driver.protected and value != bus.exchange(driver.read_outputs, protected=False):
            halt.failed(station.config.address, self._clock())
            return
        before, station.outputs.value = station.outputs.value, value
        now = self._clock()
        station.interlock.observe(value, now)
        station.found(value, now)
        if value != before:
            self._report.values(station)
        self._report.covers(station, now)
        if station.config.address in self._covers.running():
            halt.failed(station.config.address, now)

    # --- the inside ---------------------------------------------------------------------------

    def _moving(self, silent: Container[int]) -> list[Moving]:
        return [
            Moving(
                address,
                met=self._stations[address].presence.online,
                answers=address not in silent,
                heard_at=self._stations[address].presence.heard_at,
            )
            for address in self._covers.running()
        ]

    def _begun(self) -> Halt:
        if self._halt is None:
            raise RuntimeError("the line has not come to its end")
        return self._halt
