"""Modes and hold times of one module: compare them with a file, write only the differences."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bridge.commission.asker import patiently
from bridge.drivers.driver import SettingsDriver
from bridge.errors import BridgeError
from bridge.model import OutputSettings
from bridge.protocol.request import Request
from bridge.transport.bus import Bus


@dataclass(frozen=True, slots=True)
class WantedOutput:
    """The settings that a file has for one output; None: the file leaves it to the module."""

    output: int
    pulse: bool | None
    hold_ds: int | None


@dataclass(frozen=True, slots=True)
class Change:
    """One setting that differs, in words for the user."""

    output: int
    setting: str  # "mode" | "hold"
    now: str
    wanted: str

    def __str__(self) -> str:
        return f"do/{self.output} {self.setting}: {self.now} -> {self.wanted}"


class NotAppliedError(BridgeError):
    """The module confirmed a write and holds something else."""


def changes_for(now: OutputSettings, wanted: Sequence[WantedOutput]) -> tuple[Change, ...]:
    """Return what has to change so that the module has the wanted settings."""
    changes = []
    for want in wanted:
        pulse, hold_ds = _of(now, want.output)
        if want.pulse is not None and want.pulse != pulse:
            changes.append(Change(want.output, "mode", mode_word(pulse), mode_word(want.pulse)))
        if want.hold_ds is not None and want.hold_ds != hold_ds:
            changes.append(Change(want.output, "hold", hold_word(hold_ds), hold_word(want.hold_ds)))
    return tuple(changes)


def writes_for(
    driver: SettingsDriver, now: OutputSettings, wanted: Sequence[WantedOutput]
) -> tuple[Request[None], ...]:
    """Return a write for each register that differs, hold times first.

    So an output that becomes a pulse already has its new hold time.
    """
    holds = [
        driver.write_hold(want.output, want.hold_ds)
        for want in wanted
        if want.hold_ds is not None and want.hold_ds != _of(now, want.output)[1]
    ]
    pulse = _pulse_mask(now.pulse, wanted)
    modes = [driver.write_modes(pulse)] if pulse != now.pulse else []
    return (*holds, *modes)


def mode_word(pulse: bool) -> str:
    """Return the word for a mode."""
    return "pulse" if pulse else "latch"


def hold_word(hold_ds: int) -> str:
    """Return the text of a hold time."""
    return f"{hold_ds // 10}.{hold_ds % 10}s"


class SettingsAccess:
    """Reads and writes the settings of one module over a bus, which it does not own."""

    def __init__(self, bus: Bus, driver: SettingsDriver) -> None:
        self._bus = bus
        self._driver = driver

    def read(self) -> OutputSettings:
        """Read all modes and hold times."""
        return patiently(self._bus, self._driver.read_settings, protected=True)

    def apply(
        self, now: OutputSettings, wanted: Sequence[WantedOutput], done: Callable[[], None]
    ) -> int:
        """Write the differences, read them back; return the number of registers written.

        Raises:
            NotAppliedError: The values read back differ from the values written.
            ExchangeError: A register could not be written or read.
            PortError: The port is gone.
        """
        writes = writes_for(self._driver, now, wanted)
        for request in writes:
            # To write the same value again does no harm: a register is not a pulse.
            patiently(self._bus, request, protected=True)
            done()
        if left := changes_for(self.read(), wanted):
            told = "; ".join(map(str, left))
            raise NotAppliedError(
                f"station {self._driver.address} confirmed every write and still differs: {told}"
            )
        return len(writes)


def _of(settings: OutputSettings, output: int) -> tuple[bool, int]:
    return bool(settings.pulse >> (output - 1) & 1), settings.hold_ds[output - 1]


def _pulse_mask(now: int, wanted: Sequence[WantedOutput]) -> int:
    mask = now
    for want in wanted:
        bit = 1 << (want.output - 1)
        if want.pulse is not None:
            mask = mask | bit if want.pulse else mask & ~bit
    return mask
