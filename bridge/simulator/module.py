"""A simulated DIO100 or DO100: channels, EEPROM, modes, and pulses that end by themselves.

Where docs/protocol.md says [not stated], this is the choice made here, not a fact about modules:
a new ON restarts a running hold time; OFF ends a running pulse; a pulse keeps the hold time that
it began with; outputs that are ON when their mode becomes pulse stay ON; modes and hold times
lie in EEPROM from `SETTINGS_AT` on, two bytes each, high byte first; a hold time outside 1-255
(an EEPROM write can put one there) acts as the nearest of the two.

Any thread may use a module: one lock guards all of it.
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

from bridge.model import HOLD_DS, ModuleType, OutputSettings, channels_of

EEPROM_BYTES = 2048  # docs/protocol.md section 1
SETTINGS_AT = 0x0700
SWITCHINGS_KEPT = 10_000
FIRST_MODE = 0xFF00  # the high byte of a DIO100 has no meaning: readers must mask it


class Switching(NamedTuple):
    """One order to one output, or the end of its pulse.

    Attributes:
        at: Instant of the module's clock.
        output: The output, counted from 1.
        value: Its new value.
        frame: The frame that ordered it; empty for the end of a pulse and for a manual switching.
        changed: Whether the output had another value before.
    """

    at: float
    output: int
    value: bool
    frame: bytes
    changed: bool


Listener = Callable[[int, Switching], None]  # the station, and what happened there


class SimulatedModule:
    """One module. With `away` it is off the line: it neither hears nor answers; its outputs stay.

    Attributes:
        model: DIO100 or DO100.
        address: The address of DIP switches 1-5.
        wisco_only: It never answers Modbus ASCII frames. No real module is known to do this.
        away: Off the line.
        habits: Words of the dialects in which it does otherwise (`bridge.simulator.dialect`).
        switchings: The last orders to outputs and pulse ends, oldest first.
        ordered: How often a frame ordered each (output, value), pulse ends not counted.
        eeprom_writes: How often a frame wrote to the EEPROM.
    """

    def __init__(
        self,
        model: ModuleType,
        address: int,
        *,
        wisco_only: bool = False,
        clock: Callable[[], float] = time.monotonic,
        listener: Listener | None = None,
    ) -> None:
        self.model = model
        self.address = address
        self.wisco_only = wisco_only
        self.away = False
        self.habits: frozenset[str] = frozenset()
        self.switchings: deque[Switching] = deque(maxlen=SWITCHINGS_KEPT)
        self.ordered: Counter[tuple[int, bool]] = Counter()
        self.eeprom_writes = 0
        self._clock = clock
        self._listener = listener
        self._lock = threading.RLock()
        self._inputs = 0
        self._outputs = 0
        self._pulse_ends: dict[int, float] = {}
        self._eeprom = _fresh_eeprom(model)

    # --- inputs ---

    @property
    def inputs(self) -> int:
        """Return the inputs as bits."""
        with self._lock:
            return self._inputs

    def set_input(self, channel: int, value: bool) -> None:
        """Set an input, as the wires do."""
        bit = _bit(channel, self.model.inputs, "input")
        with self._lock:
            self._inputs = self._inputs | bit if value else self._inputs & ~bit

    def toggle_input(self, channel: int) -> None:
        """Invert one input."""
        bit = _bit(channel, self.model.inputs, "input")
        with self._lock:
            self._inputs ^= bit

    # --- outputs ---

    @property
    def outputs(self) -> int:
        """Return the outputs as bits, after the end of expired pulses."""
        with self._lock:
            self.settle()
            return self._outputs

    def set_output(self, channel: int, value: bool) -> None:
        """Switch an output manually, without a frame."""
        bit = _bit(channel, self.model.outputs, "output")
        self.write_outputs(bit, bit if value else 0, b"")

    def write_outputs(self, mask: int, values: int, frame: bytes) -> None:
        """Obey one frame: the outputs in `mask` take their bits of `values`, all at once."""
        with self._lock:
            self.settle()
            now = self._clock()
            for output in channels_of(mask):
                value = bool(values >> (output - 1) & 1)
                if frame:
                    self.ordered[output, value] += 1
                if output in self._pulse_ends and self._goes_on(value):
                    continue
                self._pulse_ends.pop(output, None)
                if value and self._pulse_mask() >> (output - 1) & 1:
                    self._pulse_ends[output] = now + self._holds_s(output)
                self._turn(now, output, value, frame)

    def _goes_on(self, value: bool) -> bool:
        """Return whether an order to a pulse that runs does nothing."""
        return ("second-on" if value else "off-ignored") in self.habits

    def _holds_s(self, output: int) -> float:
        return self._hold_ds(output) / (8 if "long-hold" in self.habits else 10)

    def settle(self) -> float | None:
        """End expired pulses; return the seconds until the next one ends."""
        with self._lock:
            now = self._clock()
            for output, end in sorted(self._pulse_ends.items(), key=lambda item: item[1]):
                if end > now:
                    return end - now
                del self._pulse_ends[output]
                self._turn(end, output, False, b"")
            return None

    def _turn(self, at: float, output: int, value: bool, frame: bytes) -> None:
        bit = 1 << (output - 1)
        changed = bool(self._outputs & bit) != value
        self._outputs = self._outputs | bit if value else self._outputs & ~bit
        switching = Switching(at, output, value, frame, changed)
        self.switchings.append(switching)
        if self._listener:
            self._listener(self.address, switching)

    # --- EEPROM, and the registers that lie in it ---

    @property
    def registers(self) -> int:
        """Return the number of registers: the mode, and a hold time for each output."""
        return 1 + self.model.outputs

    def read_eeprom(self, address: int, count: int) -> bytes:
        """Return bytes of the EEPROM."""
        with self._lock:
            return bytes(self._eeprom[address : address + count])

    def write_eeprom(self, address: int, data: bytes) -> None:
        """Obey a frame that writes to the EEPROM."""
        with self._lock:
            modes = self._pulse_mask()
            self._eeprom[address : address + len(data)] = data
            self.eeprom_writes += 1
            changed = modes ^ self._pulse_mask()
            if changed and "mode-clears" in self.habits:
                self.write_outputs(changed, 0, b"")

    @property
    def settings(self) -> OutputSettings:
        """Return modes and hold times as they act."""
        with self._lock:
            outputs = range(1, self.model.outputs + 1)
            return OutputSettings(self._pulse_mask(), tuple(map(self._hold_ds, outputs)))

    def set_mode(self, output: int, *, pulse: bool, hold_s: float = 1.0) -> None:
        """Set mode and hold time of one output, as a tool at the module does."""
        bit = _bit(output, self.model.outputs, "output")
        with self._lock:
            mode = self._register(0)
            self._set_register(0, mode | bit if pulse else mode & ~bit)
            self._set_register(output, round(hold_s * 10))

    def _pulse_mask(self) -> int:
        return self._register(0) & ((1 << self.model.outputs) - 1)

    def _hold_ds(self, output: int) -> int:
        return min(max(self._register(output), HOLD_DS[0]), HOLD_DS[-1])

    def _register(self, number: int) -> int:
        at = SETTINGS_AT + 2 * number
        return int.from_bytes(self._eeprom[at : at + 2], "big")

    def _set_register(self, number: int, value: int) -> None:
        at = SETTINGS_AT + 2 * number
        self._eeprom[at : at + 2] = value.to_bytes(2, "big")


def _bit(channel: int, channels: int, kind: str) -> int:
    if not 1 <= channel <= channels:
        raise ValueError(f"there is no {kind} {channel}: this module has {channels}")
    return 1 << (channel - 1)


def _fresh_eeprom(model: ModuleType) -> bytearray:
    """Return a new EEPROM: all outputs latch, all hold times 1.0 s, the rest erased."""
    eeprom = bytearray(b"\xff" * EEPROM_BYTES)
    mode = FIRST_MODE & ~((1 << model.outputs) - 1)
    registers = [mode, *[10] * model.outputs]
    settings = b"".join(value.to_bytes(2, "big") for value in registers)
    eeprom[SETTINGS_AT : SETTINGS_AT + len(settings)] = settings
    return eeprom
