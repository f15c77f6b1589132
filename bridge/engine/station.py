"""What the line worker knows of one module: its drivers, its values, its presence."""

import math
from typing import Protocol, TypeVar

from bridge.config.schema import LineConfig, OutputConfig, StationConfig
from bridge.drivers import driver_for
from bridge.drivers.driver import Driver, SettingsDriver
from bridge.drivers.modbus import ModbusDriver
from bridge.engine.cover import CoverMotion
from bridge.engine.gestures import buttons_among
from bridge.engine.interlock import Interlock
from bridge.engine.presence import Presence
from bridge.engine.tracker import BankTracker
from bridge.errors import ExchangeError
from bridge.model import (
    CoverState,
    LineProtocol,
    OutputSettings,
    Status,
    Verdict,
    Writes,
    bit,
    bits_of,
    channels_of,
)
from bridge.protocol.request import Request
from bridge.transport.bus import BusCounters
from bridge.transport.tap import Hear

T = TypeVar("T")


class Exchanger(Protocol):
    """What the engine needs of the bus: one request out, its value back, or an error."""

    @property
    def quiet_until(self) -> float:
        """No request goes out before this instant: a late reply may be on its way."""
        ...

    @property
    def sent_at(self) -> float:
        """When the last request went out."""
        ...

    @property
    def reply(self) -> bytes:
        """What the last request brought back."""
        ...

    @property
    def counters(self) -> BusCounters:
        """How the exchanges went, and what came besides."""
        ...

    @property
    def stray(self) -> bytes:
        """What was heard when bytes last came that nobody had asked for."""
        ...

    def free_at(self, station: int) -> float:
        """No request goes out to this station before this instant: its late reply has to pass."""
        ...

    def listen(self, wait_s: float = 0.0) -> bytes:
        """Takes off the line what nobody asked for; `exchange` does it before each request."""
        ...

    def tap(self, hear: Hear | None) -> None:
        """Has every piece that passes told; see `bridge.transport.bus.Bus.tap`."""
        ...

    def exchange(self, request: Request[T], *, protected: bool, not_after: float = math.inf) -> T:
        """Makes one exchange; see `bridge.transport.bus.Bus.exchange`."""
        ...

    def close(self) -> None:
        """Gives the port back."""
        ...


class Station:
    """One module on one line. Only the thread of its line touches it.

    Attributes:
        buttons: Its inputs of which gestures are told; None: it has none.
        counted: The inputs whose edges are counted.
        settings: Modes and hold times as last read; None: not known.
        wrong_model: The module that answers is not what the configuration says.
        last_error: Why it last got no valid reply to a poll.
        unsettled: Outputs whose last command was not confirmed: they may yet do it.
        told_difference: What was last said of settings that are not as declared.
        told_clash: What was last said of interlocked outputs that are ON at once.
        covers: Where its covers are, by their ids.
        told_covers: What was last said of each cover, and when.
        unanswered_at: When it last did not answer an order.
        takes_modbus: It answered a Modbus frame, or it is taken to (CONTRACT.md, promise 6).
    """

    def __init__(self, config: StationConfig, line: LineConfig) -> None:
        self.config = config
        self.reader: Driver = driver_for(line.protocol, config.address, config.model)
        self.modbus: SettingsDriver | None = _modbus_driver(config, line)
        self.modbus_is_given = (
            line.protocol is not LineProtocol.WISCO or line.writes is Writes.MODBUS
        )
        confirm = not self.reader.protected
        self.inputs = BankTracker(
            confirm=confirm,
            invert=sum(bit(channel.channel) for channel in config.inputs if channel.invert),
            debounce_s={c.channel: c.debounce_s for c in config.inputs if c.debounce_s > 0},
        )
        self.outputs = BankTracker(confirm=confirm)
        self.buttons = buttons_among(config.inputs)
        self.counted = bits_of(c.channel for c in config.inputs if c.count is not None)
        self.interlock = Interlock(config.interlock, config.interlock_dead_s)
        self.covers = {cover.id: CoverMotion(cover) for cover in config.covers}
        self.told_covers: dict[str, tuple[CoverState, int | None, float]] = {}
        self.presence = Presence()
        self.settings: OutputSettings | None = None
        self.takes_modbus = self.modbus_is_given
        self.wrong_model = False
        self.absence_logged = False
        self.last_error: ExchangeError | None = None
        self.unsettled = 0
        self.unanswered_at = 0.0
        self.told_difference: str | None = None
        self.told_clash: str | None = None
        self._all_outputs = (1 << config.model.outputs) - 1
        self._declared_pulse = sum(bit(c.channel) for c in config.outputs if c.mode == "pulse")

    def forget(self) -> None:
        """It is gone: whatever comes back in its place is met as a stranger."""
        self.inputs.forget()
        if self.buttons is not None:
            self.buttons.forget()
        self.outputs.forget()
        self.settings = None
        self.takes_modbus = self.modbus_is_given
        self.unsettled = 0
        self.told_covers.clear()
        for cover in self.covers.values():
            cover.lost()

    def ordered(self, mask: int, values: int, now: float) -> None:
        """A frame that orders these outputs goes out now."""
        self.interlock.ordered(values)
        self.outputs.drop_candidate()
        for cover in self.covers.values():
            cover.ordered(mask, values, now)

    def found(self, outputs: int, now: float) -> None:
        """A read that counts found the outputs so."""
        for cover in self.covers.values():
            cover.read(outputs, now)

    @property
    def writer(self) -> Driver:
        """Who builds write frames: Modbus where the module takes it (LRC, station)."""
        return self.modbus if self.modbus is not None and self.takes_modbus else self.reader

    @property
    def listens(self) -> bool:
        """Whether an order to it is not in vain: that may take 2 s, from others too (promise 7)."""
        return self.presence.online and not self.presence.silent_since(self.unanswered_at)

    @property
    def known_pulse(self) -> int:
        """Outputs that are declared, or were read, to be in pulse mode."""
        return self._declared_pulse | (self.settings.pulse if self.settings else 0)

    @property
    def maybe_pulse(self) -> int:
        """Outputs whose mode was not read as latch: they count as pulse (promise 1)."""
        return self.known_pulse if self.settings else self._all_outputs

    def commanded(self, outputs: int, verdict: Verdict) -> None:
        """Keeps in mind which outputs may yet do what they were told, though nobody saw it."""
        if verdict.status is Status.DONE and verdict.seen_on is not False:
            self.unsettled &= ~outputs
        elif verdict.status is not Status.REFUSED:
            self.unsettled |= outputs

    def unasked(self, before: int, after: int) -> int:
        """Of the outputs that a poll found changed, those that nobody told to (FAILURES.md A7).

        A pulse that ended did what it should.
        """
        changed = before ^ after
        ended = changed & before & self.maybe_pulse
        unasked = changed & ~ended & ~self.unsettled
        self.unsettled &= ~changed
        return unasked

    def holds_s(self, outputs: int) -> set[float]:
        """After how long these go OFF by themselves, where that was read from the module."""
        if self.settings is None:
            return set()
        pulses = channels_of(outputs & self.settings.pulse)
        return {self.settings.hold_ds[output - 1] / 10 for output in pulses}

    def read_outputs(self, bus: Exchanger, tries: int) -> int | None:
        """Reads the outputs now; over unprotected frames two equal replies in a row count.

        Returns None when no valid (and agreeing) reply came within that many exchanges.
        Writes are checked with it, so it asks in the frames that can be believed at once.
        """
        driver = self.writer
        before: int | None = None
        for _ in range(tries):
            try:
                value = bus.exchange(driver.read_outputs, protected=driver.protected)
            except ExchangeError:
                continue
            if driver.protected or value == before:
                return value
            before = value
        return None

    def differing_settings(self) -> str | None:
        """What the module holds other than declared, in words; None: nothing differs."""
        if self.settings is None:
            return None
        complaints = [
            text
            for output in self.config.outputs
            if (text := _difference(output, self.settings)) is not None
        ]
        return "; ".join(complaints) or None


def _modbus_driver(config: StationConfig, line: LineConfig) -> SettingsDriver | None:
    if line.protocol is not LineProtocol.WISCO:
        return ModbusDriver(config.address, config.model, line.protocol)
    # Station 0 is Modbus' broadcast address: it is never asked (PROTOCOL.md section 1).
    if line.writes is Writes.WISCO or config.address == 0:
        return None
    return ModbusDriver(config.address, config.model, LineProtocol.MODBUS_ASCII)


def _difference(output: OutputConfig, settings: OutputSettings) -> str | None:
    mode = "pulse" if settings.pulse & bit(output.channel) else "latch"
    if output.mode is not None and output.mode != mode:
        return f"output {output.channel} is in {mode} mode, declared {output.mode}"
    hold_s = settings.hold_ds[output.channel - 1] / 10
    if output.hold_s is not None and round(output.hold_s * 10) != round(hold_s * 10):
        return f"output {output.channel} holds {hold_s:.1f} s, declared {output.hold_s:.1f} s"
    return None
