"""What the engine needs of a driver: one station's abilities as ready requests."""

from typing import Protocol

from bridge.model import ModuleType, OutputSettings
from bridge.protocol.request import Request


class Driver(Protocol):
    """Requests to one station in one protocol. Reads are prebuilt: they are sent for ever."""

    @property
    def station(self) -> int:
        """Return its address, 0-31."""
        ...

    @property
    def module(self) -> ModuleType:
        """Return what it is configured to be."""
        ...

    @property
    def protected(self) -> bool:
        """Return whether replies carry station and checksum.

        So that a single one can be believed.
        """
        ...

    @property
    def read_inputs(self) -> Request[int]:
        """Return all 16 inputs of a DIO100, bit n-1 for input n. A DO100 refuses it.

        That tells it.
        """
        ...

    @property
    def read_outputs(self) -> Request[int]:
        """Return all outputs of `module`, bit n-1 for output n.

        Another width is a BadReplyError.
        """
        ...

    def write_outputs(self, mask: int, values: int, current: int) -> Request[None]:
        """Return one frame that sets the outputs in `mask` to `values`.

        `current` is what was just read: a Modbus range writes the gaps back as they are.

        Raises:
            ValueError: An empty mask, or a bit outside the module.
        """
        ...


class SettingsDriver(Driver, Protocol):
    """A driver that also reaches modes and hold times: Modbus (docs/protocol.md section 3)."""

    @property
    def read_settings(self) -> Request[OutputSettings]:
        """Return all modes and hold times in one read: holding registers 40001 on."""
        ...

    def write_modes(self, pulse: int) -> Request[None]:
        """Digital output mode, bit n-1 set: output n in pulse mode. Wears EEPROM."""
        ...

    def write_hold(self, output: int, hold_ds: int) -> Request[None]:
        """Hold time of one output, 1-255 tenths of a second. Wears EEPROM."""
        ...
