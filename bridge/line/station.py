"""The state of one module for its line worker: drivers, values, presence."""

import math
from collections.abc import Callable

from bridge.config.schema import LineConfig, OutputConfig, StationConfig
from bridge.drivers import driver_for, settings_driver_for
from bridge.drivers.driver import Driver, SettingsDriver
from bridge.errors import ExchangeError, RefusedError
from bridge.line.exchanger import Exchanger
from bridge.line.rules.cover import CoverMotion
from bridge.line.rules.gestures import buttons_among
from bridge.line.rules.interlock import Interlock
from bridge.line.rules.presence import Presence
from bridge.line.rules.tracker import BankTracker
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

# Every so many contacts a silent module is asked in Wisco frames too: if it was exchanged, the new
# one may take no others.
_WISCO_EVERY = 4
# One that was never met may take Wisco frames alone, so it is asked in these at least every 30 s.
# Its first contacts come sooner: after 0.5, 1, 2, 4, 8 and 16 s. Of these the ones with these
# numbers need no late window; the Wisco frames come after 7.5, 24 and from then on 30 s.
_KNOCKS_UNMET = frozenset({1, 2, 3, 5})

# If replies do not carry their station and another master asks too: the time between reads that
# must agree, and how long the line is listened to before each of them.
APART_S = 0.5
PASS_S = 0.06


class Station:
    """One module on one line. Only the thread of its line uses it.

    Attributes:
        buttons: Its inputs with gestures; None: it has none.
        counted: The inputs whose edges are counted.
        settings: Modes and hold times as last read; None: not known.
        refuses_settings: It refused and never answered: it is not asked before the next contact.
        expected: Modes and hold times as first read, or as set through the bridge since.
        read_only: Outputs that are not written.
        wrong_model: The module that answers is not what the configuration says.
        told_reading: Which reading of the manual was last said to explain its absence.
        last_error: Why it last got no valid reply to a poll.
        unsettled: Outputs whose last command was not confirmed: they may yet do it.
        told_online: Whether it was last said to be online.
        is_unknown: It went offline: what the bus learned of it is forgotten at the next contact.
        told_difference: What was last said of settings that are not as declared.
        told_clash: What was last said of interlocked outputs that are ON at once.
        covers: Where its covers are, by their ids.
        told_covers: What was last said of each cover, and when.
        unanswered_at: When it last did not answer an order.
        takes_modbus: It answered a Modbus frame, or counts as if it had (docs/contract.md, promise
            6).
        took_modbus: Whether it did at the last contact; None: there was none.
        vain_contacts: How often it was contacted in vain since.
    """

    def __init__(
        self,
        config: StationConfig,
        line: LineConfig,
        contested: Callable[[], bool] = lambda: False,
    ) -> None:
        self.config = config
        self._contested = contested  # whether replies to another master are heard
        self._gateway = "://" in line.port  # it may let in two programs, and give both all replies
        self.reader: Driver = driver_for(line.protocol, config.address, config.model)
        self.modbus: SettingsDriver | None = settings_driver_for(line, config)
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
        self.expected: OutputSettings | None = None
        self.refuses_settings = False
        self.read_only = config.read_only_outputs
        self.takes_modbus = self.modbus_is_given
        self.took_modbus: bool | None = None
        self.vain_contacts = 0
        self.wrong_model = False
        self.absence_logged = False
        self.told_reading: str | None = None
        self.last_error: ExchangeError | None = None
        self.unsettled = 0
        self.unanswered_at = 0.0
        self.told_online = False
        self.is_unknown = False
        self.told_difference: str | None = None
        self.told_clash: str | None = None
        self._all_outputs = (1 << config.model.outputs) - 1
        self._declared_pulse = sum(bit(c.channel) for c in config.outputs if c.mode == "pulse")

    def forget(self) -> None:
        """Forget what was read: the next module at this address is contacted as a new one."""
        self.inputs.forget()
        if self.buttons is not None:
            self.buttons.forget()
        self.outputs.forget()
        self.settings = self.expected = None
        self.refuses_settings = False
        self.takes_modbus = self.modbus_is_given
        self.unsettled = 0
        self.told_covers.clear()
        for cover in self.covers.values():
            cover.lost()

    def ordered(self, mask: int, values: int, now: float) -> None:
        """Record that a frame that orders these outputs is sent now."""
        self.interlock.ordered(values)
        self.outputs.drop_candidate()
        for cover in self.covers.values():
            cover.ordered(mask, values, now)

    def found(self, outputs: int, now: float) -> None:
        """Use a confirmed read of the outputs."""
        for cover in self.covers.values():
            cover.observe(outputs, now)

    @property
    def writer(self) -> Driver:
        """Return the driver for writes: Modbus if the module takes it (LRC, station)."""
        return self.modbus if self.modbus is not None and self.takes_modbus else self.reader

    @property
    def is_contested(self) -> bool:
        """Return whether a reply may belong to another master: it does not carry its station."""
        return not self.reader.protected and self._contested()

    @property
    def contact_asker(self) -> Driver:
        """Return the driver for the contact: is it there, and which model is it."""
        return self.writer if self.is_contested else self.reader

    @property
    def knocker(self) -> Driver | None:
        """Return the driver that first asks whether it is there; None: the contact asks itself.

        If no reply comes to a Modbus frame, the others are read in Wisco frames at once.
        """
        if self.reader.protected or self.took_modbus is False or self.is_contested:
            return None
        if self.took_modbus is None:
            return self.modbus if self.vain_contacts in _KNOCKS_UNMET else None
        return self.modbus if (self.vain_contacts + 1) % _WISCO_EVERY else None

    def asker(self, bank: BankTracker, *, late: bool = False) -> Driver:
        """Return the driver for the next read; a decisive read uses frames with a station.

        So does every read while a `late` reply may come that carries none.
        """
        decides = self.is_contested or late or (self._gateway and bank.is_waiting)
        return self.writer if decides else self.reader

    def apart_s(self, asked: Driver) -> float:
        """Return the least time between equal replies to `asked` (F12)."""
        if asked.protected or not (self._gateway or self.is_contested):
            return 0.0
        if self.writer.protected:
            return math.inf
        return APART_S if self.is_contested else 0.0

    def let_others_pass(self, bus: Exchanger) -> None:
        """Wait until replies to others and late ones have passed, before an unprotected read."""
        if not self.writer.protected and (self._gateway or self.is_contested):
            bus.listen(PASS_S)

    @property
    def listens(self) -> bool:
        """Return whether an order may be answered: one in vain takes up to 2 s from the others.

        See docs/contract.md, promise 7.
        """
        return self.presence.online and not self.presence.silent_since(self.unanswered_at)

    @property
    def known_pulse(self) -> int:
        """Return the outputs that are declared or read as pulses."""
        return self._declared_pulse | (self.settings.pulse if self.settings else 0)

    @property
    def maybe_pulse(self) -> int:
        """Return the outputs that were not read as latch: they count as pulses (promise 1)."""
        return self.known_pulse if self.settings else self._all_outputs

    def latches_of(self, outputs: int) -> int:
        """Return those of `outputs` that were read as latch."""
        return outputs & ~self.settings.pulse if self.settings else 0

    @property
    def tells_settings(self) -> bool:
        """Return whether its modes and hold times can be read."""
        return self.modbus is not None and self.takes_modbus and not self.refuses_settings

    def read_settings(self, bus: Exchanger, tries: int) -> bool:
        """Read modes and hold times now; return whether that worked within `tries` exchanges."""
        for _ in range(tries):
            if self.modbus is None or not self.tells_settings:
                return False
            try:
                settings = bus.exchange(self.modbus.read_settings, protected=True)
            except RefusedError:
                self.settings = None  # the old answer may not hold any more
                # One that answered before has settings: it was busy or is defective, and is asked
                # again.
                self.refuses_settings = self.expected is None
                continue
            except ExchangeError:
                continue
            self.learn(settings)
            return True
        return False

    def learn(self, settings: OutputSettings) -> None:
        """Use modes and hold times that were read."""
        self.settings = settings
        if self.expected is None:
            self.expected = settings

    def accept(self, output: int) -> None:
        """Record that the settings of this output were set through the bridge."""
        if self.settings is None or self.expected is None:
            return
        own, others = bit(output), self.expected.pulse & ~bit(output)
        hold_ds = list(self.expected.hold_ds)
        hold_ds[output - 1] = self.settings.hold_ds[output - 1]
        self.expected = OutputSettings(others | self.settings.pulse & own, tuple(hold_ds))

    def commanded(self, outputs: int, verdict: Verdict) -> None:
        """Remember outputs that may still obey, although no read confirmed it."""
        if verdict.status is Status.DONE and verdict.seen_on is not False:
            self.unsettled &= ~outputs
        elif verdict.status is not Status.REFUSED:
            self.unsettled |= outputs

    def unasked(self, before: int, after: int) -> int:
        """Return changed outputs that no command or pulse end explains.

        `before` and `after` are the values of two polls. See docs/failures.md A7.
        """
        changed = before ^ after
        ended = changed & before & self.maybe_pulse
        unasked = changed & ~ended & ~self.unsettled
        self.unsettled &= ~changed
        return unasked

    def holds_s(self, outputs: int) -> set[float]:
        """Return the hold times of these outputs, if they were read."""
        if self.settings is None:
            return set()
        pulses = channels_of(outputs & self.settings.pulse)
        return {self.settings.hold_ds[output - 1] / 10 for output in pulses}

    def read_outputs(self, bus: Exchanger, tries: int) -> int | None:
        """Read the outputs now; with unprotected frames two equal replies in a row count.

        Return None if no valid (and agreeing) reply came within `tries` exchanges. Writes are
        checked with it, so it uses the frames that can be trusted at once.
        """
        driver = self.writer
        before: int | None = None
        for _ in range(tries):
            self.let_others_pass(bus)
            try:
                value = bus.exchange(driver.read_outputs, protected=driver.protected)
            except ExchangeError:
                continue
            if driver.protected or value == before:
                return value
            before = value
        return None

    def differing_settings(self) -> str | None:
        """Return how its settings differ from the declaration or from those at the contact."""
        if self.settings is None:
            return None
        complaints = [
            text
            for output in self.config.outputs
            if (text := _difference(output, self.settings, self.expected)) is not None
        ]
        return "; ".join(complaints) or None


def _difference(
    output: OutputConfig, settings: OutputSettings, expected: OutputSettings | None
) -> str | None:
    """Return one sentence about one output; undeclared settings should be as they were."""
    mode, hold_s = _mode_and_hold(output, settings)
    if output.mode is not None and output.mode != mode:
        return f"output {output.channel} is in {mode} mode, declared {output.mode}"
    if output.hold_s is not None and round(output.hold_s * 10) != round(hold_s * 10):
        return f"output {output.channel} holds {hold_s:.1f} s, declared {output.hold_s:.1f} s"
    if expected is None:
        return None
    was, held_s = _mode_and_hold(output, expected)
    if was != mode:
        return f"output {output.channel} is in {mode} mode, and was in {was} mode"
    if mode == "pulse" and held_s != hold_s:
        return f"output {output.channel} holds {hold_s:.1f} s, and held {held_s:.1f} s"
    return None


def _mode_and_hold(output: OutputConfig, settings: OutputSettings) -> tuple[str, float]:
    mode = "pulse" if settings.pulse & bit(output.channel) else "latch"
    return mode, settings.hold_ds[output.channel - 1] / 10
