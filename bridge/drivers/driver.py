"""The interface of a driver: everything that one station can do, as ready requests."""

from typing import Protocol

from bridge.model import ModuleType, OutputSettings
from bridge.protocol.request import Request


class Driver(Protocol):
    """Requests to one station in one protocol.

    Read requests are built once, because they repeat.
    """

    @property
    def address(self) -> int:
        """Return the address, 0-31."""

    @property
    def module(self) -> ModuleType:
        """Return the configured model."""

    @property
    def protected(self) -> bool:
        """Return whether replies carry station and checksum, so that one reply is enough."""

    @property
    def read_inputs(self) -> Request[int]:
        """Return the read of all 16 inputs of a DIO100; bit n-1 is input n.

        A DO100 refuses it, which identifies the model.
        """

    @property
    def read_outputs(self) -> Request[int]:
        """Return the read of all outputs of `module`; bit n-1 is output n.

        A reply with another number of outputs is a BadReplyError.
        """

    def write_outputs(self, mask: int, values: int, current: int) -> Request[None]:
        """Return one frame that sets the outputs in `mask` to `values`.

        `current` is the last read: a Modbus range write also writes the outputs in between, and
        sends them their present values.

        Raises:
            ValueError: An empty mask, or a bit that the module does not have.
        """


class SettingsDriver(Driver, Protocol):
    """A driver that also reaches modes and hold times, by Modbus (docs/protocol.md section 3)."""

    @property
    def read_settings(self) -> Request[OutputSettings]:
        """Return one read of all modes and hold times: holding registers from 40001."""

    def write_modes(self, pulse: int) -> Request[None]:
        """Return the write of all output modes; bit n-1 set: output n is a pulse.

        Wears the EEPROM.
        """

    def write_hold(self, output: int, hold_ds: int) -> Request[None]:
        """Return the write of one hold time, 1-255 tenths of a second. Wears the EEPROM."""
