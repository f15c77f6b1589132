"""Writes one mode or hold time of a module, and returns the verdict.

Modes and hold times are in the EEPROM, which wears out with writes (docs/protocol.md section 3). So
they are read first and written only if they differ. A write is repeated at most once, and only
after a read that shows the old value.
"""

from collections.abc import Callable

from bridge.drivers.driver import SettingsDriver
from bridge.errors import ExchangeError, ExpiredError, PortError, RefusedError
from bridge.line.exchanger import Exchanger
from bridge.line.station import Station
from bridge.model import (
    OutputSettings,
    Reason,
    Setting,
    SettingCommand,
    Status,
    Verdict,
    bit,
    verdict_on,
)
from bridge.protocol.request import Request

# These and the write take less than 2 s if no module answers, so other modules wait no longer.
_READ_TRIES = 3


class SettingsWrite:
    """One command in progress. Used once, by the thread of the line.

    Attributes:
        port_error: Set if the port was lost meanwhile.
    """

    def __init__(
        self,
        command: SettingCommand,
        station: Station,
        bus: Exchanger,
        clock: Callable[[], float],
    ) -> None:
        self.port_error: PortError | None = None
        self._command = command
        self._station = station
        self._bus = bus
        self._clock = clock
        self._sent = False
        self._refusal: RefusedError | None = None

    def run(self) -> Verdict:
        """Carry out the command. Settings that were read are then in `station.settings`."""
        try:
            return self._carry_out()
        except PortError as error:
            self.port_error = error
            # It is not known how much of the frame was sent, so the verdict is "unknown".
            status = Status.UNKNOWN if self._sent else Status.FAILED
            return self._verdict(status, Reason.PORT_DOWN, str(error))

    def _carry_out(self) -> Verdict:
        modbus = self._station.modbus
        if modbus is None or not self._station.takes_modbus:
            return self._verdict(
                Status.REFUSED,
                Reason.READ_ONLY,
                "modes and hold times are reached in Modbus frames alone, and this station is not "
                "spoken to in those",
            )
        if self._is_late():
            return self._verdict(Status.REFUSED, Reason.EXPIRED)
        current = self._read(modbus)
        if current is None:
            return self._failed_unread()
        if self._agrees(current):
            return self._verdict(Status.DONE)
        if self._is_late():
            return self._verdict(Status.REFUSED, Reason.EXPIRED)
        return self._write(modbus, current)

    def _write(self, modbus: SettingsDriver, current: OutputSettings) -> Verdict:
        if not self._transmit(modbus, current):
            return self._verdict(Status.REFUSED, Reason.EXPIRED)
        refusal = self._refusal
        seen = self._read(modbus)
        if refusal is None and seen is not None and not self._agrees(seen) and not self._is_late():
            self._transmit(modbus, seen)
            refusal = self._refusal
            seen = self._read(modbus)
        if refusal is not None:
            return self._module_refused(refusal)
        if seen is None:
            return self._verdict(Status.UNKNOWN, Reason.NO_REPLY)
        if self._agrees(seen):
            return self._verdict(Status.DONE)
        return self._verdict(Status.FAILED, Reason.NOT_CONFIRMED)

    def _transmit(self, modbus: SettingsDriver, current: OutputSettings) -> bool:
        """Send the frame once; return False if it is too late. The next read shows the result."""
        self._refusal = None
        request, deadline = self._request(modbus, current), self._command.deadline
        try:
            self._bus.exchange(request, protected=modbus.protected, not_after=deadline)
        except ExpiredError:
            return False
        except PortError:
            self._sent = True
            raise
        except RefusedError as error:
            self._refusal = error
        except ExchangeError:
            pass
        self._sent = True
        return True

    def _request(self, modbus: SettingsDriver, current: OutputSettings) -> Request[None]:
        command = self._command
        if command.setting is Setting.HOLD:
            return modbus.write_hold(command.output, command.value)
        # One register holds the modes of all outputs: the others are written as they were read.
        others = current.pulse & ~bit(command.output)
        return modbus.write_modes(others | bit(command.output) * command.value)

    def _read(self, modbus: SettingsDriver) -> OutputSettings | None:
        """Return the present settings; None: not readable, and `_refusal` may hold why."""
        self._refusal = None
        for _ in range(_READ_TRIES):
            try:
                settings = self._bus.exchange(modbus.read_settings, protected=modbus.protected)
            except RefusedError as error:
                self._refusal = error
                return None
            except ExchangeError:
                continue
            self._station.learn(settings)
            return settings
        return None

    def _agrees(self, settings: OutputSettings) -> bool:
        command = self._command
        if command.setting is Setting.HOLD:
            return settings.hold_ds[command.output - 1] == command.value
        return bool(settings.pulse & bit(command.output)) == bool(command.value)

    def _is_late(self) -> bool:
        """Return whether a frame would be sent after the deadline, with the wait of the bus."""
        free_at = self._bus.free_at(self._station.config.address, protected=True)
        return max(self._clock(), free_at) > self._command.deadline

    def _failed_unread(self) -> Verdict:
        if self._refusal is not None:
            return self._module_refused(self._refusal)
        return self._verdict(Status.FAILED, Reason.NO_REPLY, "nothing was written")

    def _module_refused(self, error: RefusedError) -> Verdict:
        return self._verdict(Status.FAILED, Reason.MODULE_REFUSED, str(error), error.code)

    def _verdict(
        self,
        status: Status,
        reason: Reason | None = None,
        detail: str | None = None,
        code: int | None = None,
    ) -> Verdict:
        return verdict_on(self._command, self._clock(), status, reason, code=code, detail=detail)
