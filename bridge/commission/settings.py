"""Modes and hold times of one module: what a file wants, what differs, and writing just that."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from bridge.drivers.driver import SettingsDriver
from bridge.errors import BadReplyError, BridgeError, NoReplyError
from bridge.model import OutputSettings
from bridge.protocol.request import Request
from bridge.transport.bus import Bus

T = TypeVar("T")

_TRIES = 3


@dataclass(frozen=True, slots=True)
class WantedOutput:
    """Describe what a file says of one output; None: the file leaves it to the module."""

    output: int
    pulse: bool | None
    hold_ds: int | None


@dataclass(frozen=True, slots=True)
class Change:
    """One setting that differs, as words for its owner."""

    output: int
    setting: str  # "mode" | "hold"
    now: str
    wanted: str

    def __str__(self) -> str:
        return f"do/{self.output} {self.setting}: {self.now} -> {self.wanted}"


class NotAppliedError(BridgeError):
    """The module confirmed a write and holds something else."""


def changes_for(now: OutputSettings, wanted: Sequence[WantedOutput]) -> tuple[Change, ...]:
    """Tell what has to change so that the module has what is wanted."""
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
    """Give a write for each register that differs, hold times first.

    An output that becomes a pulse has its own hold time by then, not what was left there.
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
    """Return how a mode is written."""
    return "pulse" if pulse else "latch"


def hold_word(hold_ds: int) -> str:
    """Return how a hold time is written."""
    return f"{hold_ds // 10}.{hold_ds % 10}s"


class SettingsAccess:
    """Reads and writes the settings of one module over a bus, which it does not own."""

    def __init__(self, bus: Bus, driver: SettingsDriver) -> None:
        self._bus = bus
        self._driver = driver

    def read(self) -> OutputSettings:
        """Read all modes and hold times."""
        return self._patiently(self._driver.read_settings)

    def apply(
        self, now: OutputSettings, wanted: Sequence[WantedOutput], done: Callable[[], None]
    ) -> int:
        """Write what differs, read it back, and tell how many registers that took.

        Raises:
            NotAppliedError: What was read back is not what was written.
            ExchangeError: A register could not be written or read.
            PortError: The port is gone.
        """
        writes = writes_for(self._driver, now, wanted)
        for request in writes:
            # The same value once more does no harm: a register is no pulse.
            self._patiently(request)
            done()
        if left := changes_for(self.read(), wanted):
            told = "; ".join(map(str, left))
            raise NotAppliedError(
                f"station {self._driver.station} confirmed every write and still differs: {told}"
            )
        return len(writes)

    def _patiently(self, request: Request[T]) -> T:
        for _ in range(_TRIES - 1):
            try:
                return self._bus.exchange(request, protected=True)
            except (NoReplyError, BadReplyError):
                continue
        return self._bus.exchange(request, protected=True)


def _of(settings: OutputSettings, output: int) -> tuple[bool, int]:
    return bool(settings.pulse >> (output - 1) & 1), settings.hold_ds[output - 1]


def _pulse_mask(now: int, wanted: Sequence[WantedOutput]) -> int:
    mask = now
    for want in wanted:
        bit = 1 << (want.output - 1)
        if want.pulse is not None:
            mask = mask | bit if want.pulse else mask & ~bit
    return mask
