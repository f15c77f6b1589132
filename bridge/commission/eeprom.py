"""The EEPROM of one module over REE and WEE: read it, compare it, write the differences.

An interrupted write needs no record of its progress: the next run reads the EEPROM, finds the
remaining differences, and writes these.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bridge.commission.asker import TRIES, patiently
from bridge.errors import BadReplyError, BridgeError, NoReplyError
from bridge.line.actions.contact import Asked
from bridge.protocol.wisco_eeprom import EEPROM_BYTES, ReadEeprom, WriteEeprom

# docs/protocol.md section 2: the example of the manual reads 500 bytes at once. A lost block costs
# less if it is short.
READ_BLOCK_BYTES = 128
# [not stated] how many bytes one WEE may carry. EEPROM chips of this size have pages of 16 bytes,
# and a write beyond the end of its page continues at the beginning of the page.
PAGE_BYTES = 16

Progress = Callable[[int, int], None]  # bytes done, of bytes in all


@dataclass(frozen=True, slots=True)
class Patch:
    """Differing bytes side by side, within one page."""

    address: int
    data: bytes


class NotRestoredError(BridgeError):
    """The module does not hold what was written."""


def patches_for(now: bytes, wanted: Mapping[int, int]) -> tuple[Patch, ...]:
    """Return what has to be written to change `now` into `wanted`; equal bytes are left out."""
    patches: list[Patch] = []
    for address in sorted(at for at, byte in wanted.items() if now[at] != byte):
        byte = bytes([wanted[address]])
        last = patches[-1] if patches else None
        beside = last is not None and last.address + len(last.data) == address
        if last and beside and address % PAGE_BYTES:
            patches[-1] = Patch(last.address, last.data + byte)
        else:
            patches.append(Patch(address, byte))
    return tuple(patches)


class Eeprom:
    """Reads and writes over a bus, which it does not own."""

    def __init__(self, bus: Asked, address: int, block_bytes: int = READ_BLOCK_BYTES) -> None:
        self._bus = bus
        self._address = address
        self._block_bytes = block_bytes

    def read(self, progress: Progress) -> bytes:
        """Read all of it.

        Raises:
            ExchangeError: A block could not be read.
            PortError: The port is gone.
        """
        data = b""
        for address in range(0, EEPROM_BYTES, self._block_bytes):
            data += self._read_block(address, self._block_bytes)
            progress(len(data), EEPROM_BYTES)
        return data

    def write(self, patches: tuple[Patch, ...], progress: Progress) -> None:
        """Write the patches, and read each one back before the next.

        Raises:
            NotRestoredError: The module confirmed a write and holds something else.
            ExchangeError: A patch could not be written.
            PortError: The port is gone.
        """
        total = sum(len(patch.data) for patch in patches)
        done = 0
        for patch in patches:
            self._write_patch(patch)
            done += len(patch.data)
            progress(done, total)

    def _write_patch(self, patch: Patch) -> None:
        request = WriteEeprom(self._address, patch.address, patch.data)
        for left in reversed(range(TRIES)):
            try:
                self._bus.exchange(request, protected=False)
            except (NoReplyError, BadReplyError):
                # It may have been written in spite of the error. Writes wear the EEPROM, so read
                # first.
                if self._holds(patch):
                    return
                if not left:
                    raise
            else:
                break
        if not self._holds(patch):
            found = self._read_block(patch.address, len(patch.data))
            raise NotRestoredError(
                f"station {self._address} holds {found.hex(' ')} at {patch.address:04X}h "
                f"after {patch.data.hex(' ')} was written there: is the EEPROM worn out?"
            )

    def _holds(self, patch: Patch) -> bool:
        return self._read_block(patch.address, len(patch.data)) == patch.data

    def _read_block(self, address: int, count: int) -> bytes:
        return patiently(self._bus, ReadEeprom(self._address, address, count), protected=False)
