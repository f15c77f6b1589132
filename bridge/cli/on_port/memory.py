"""What a module keeps: its modes and hold times, and its EEPROM; read and written in one visit.

Only what differs is written, and everything is read back. An interruption says how far it came.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from bridge.cli.frame.interrupt import saying
from bridge.cli.frame.terminal import progress
from bridge.cli.on_port.one_station import Visit
from bridge.commission.eeprom import Eeprom, NotRestoredError, Patch, Progress, patches_for
from bridge.commission.settings import SettingsAccess, WantedOutput
from bridge.drivers.modbus import ModbusDriver
from bridge.errors import BridgeError, ExchangeError, NoReplyError, PortError
from bridge.model import OutputSettings
from bridge.protocol.wisco_eeprom import EEPROM_BYTES

# Approximate characters on the wire for each byte: two digits for a read; for a write also the
# frames around a few bytes, and the read after it.
_CHARS_READ, _CHARS_WRITTEN = 2.3, 12
_BITS_PER_CHAR = 10


def read_settings(met: Visit) -> OutputSettings:
    """Return all modes and hold times.

    Raises:
        BridgeError: The module takes no Modbus frames.
        ExchangeError: A register could not be read.
    """
    try:
        return _access(met).read()
    except NoReplyError as error:
        # It was contacted a moment ago, so it is there.
        raise BridgeError(
            f"{met.place.name} answers no Modbus frames, and its settings go in them alone: is it "
            "a module that speaks Wisco only?"
        ) from error


def write_settings(
    met: Visit, now: OutputSettings, wanted: Sequence[WantedOutput], again: str
) -> int:
    """Write what differs; return the number of registers. `again`: what does the rest."""
    done = 0

    def count() -> None:
        nonlocal done
        done += 1

    with saying(lambda: f"{done} registers are written to {met.place.name}: {again} does the rest"):
        return _access(met).apply(now, wanted, count)


def read_eeprom(met: Visit, stopped: str) -> bytes:
    """Return all bytes. `stopped`: the effect of an interruption, in words."""
    with _bar(met, "read", _CHARS_READ, EEPROM_BYTES, stopped) as show:
        return Eeprom(met.bus, met.place.address).read(show)


def write_eeprom(met: Visit, patches: tuple[Patch, ...], again: str) -> None:
    """Write the patches. `again`: the command that goes on from an interruption."""
    done = 0

    def count(so_far: int, total: int) -> None:
        nonlocal done
        done = so_far
        show(so_far, total)

    goes_on = f"{again} again, and it goes on from there"
    try:
        with _bar(met, "written", _CHARS_WRITTEN, size_of(patches), goes_on) as show:
            Eeprom(met.bus, met.place.address).write(patches, count)
    except (PortError, ExchangeError) as error:
        raise BridgeError(
            f"{error}; {done} of {size_of(patches)} bytes are written and read back: {goes_on}"
        ) from error


def verify_eeprom(met: Visit, content: Mapping[int, int], stopped: str) -> None:
    """Read all bytes once more.

    Raises:
        NotRestoredError: They are not what was written.
    """
    left = patches_for(read_eeprom(met, stopped), content)
    if left:
        raise NotRestoredError(
            f"{size_of(left)} bytes differ after all, the first at {left[0].address:04X}h: does "
            "another program write to this module, or the module itself?"
        )


def size_of(patches: tuple[Patch, ...]) -> int:
    """Return the number of bytes in patches."""
    return sum(len(patch.data) for patch in patches)


def _access(met: Visit) -> SettingsAccess:
    model, framing = met.station.config.model, met.place.line.protocol.in_modbus
    return SettingsAccess(met.bus, ModbusDriver(met.place.address, model, framing))


@contextmanager
def _bar(met: Visit, word: str, chars: float, size: int, stopped: str) -> Iterator[Progress]:
    """Show the progress; the time left is computed from the time of a byte on the wire."""
    byte_s = chars * _BITS_PER_CHAR / met.place.line.baud
    done = 0

    def show(so_far: int, of: int) -> None:
        nonlocal done
        done = so_far
        tell((of - done) * byte_s, f"{done} of {of} bytes of {met.place.name} {word}")

    with (
        saying(lambda: f"{done} of {size} bytes of {met.place.name} are {word}: {stopped}"),
        progress(size * byte_s) as tell,
    ):
        yield show
