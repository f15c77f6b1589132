"""`wisco2mqtt eeprom`: the EEPROM of one module to a file, compared with one, and back."""

import argparse
import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from bridge.cli.confirm import confirmed
from bridge.cli.eeprom_broker import read_through_broker
from bridge.cli.one_station import Place, Visit, add_flags, find_place, visit
from bridge.cli.terminal import progress
from bridge.cli.usage import UsageError
from bridge.commission.eeprom import Eeprom, NotRestoredError, Patch, Progress, patches_for
from bridge.commission.image import ImageFormat, format_of, read_image, write_image
from bridge.errors import BridgeError, ExchangeError, PortError
from bridge.model import LineProtocol
from bridge.protocol.wisco_eeprom import EEPROM_BYTES

NAME = "eeprom"
HELP = "the EEPROM of one module: dump, diff, restore"
EXAMPLES = (
    "eeprom dump garage garage.hex",
    "eeprom diff garage garage.hex",
    "eeprom restore --port /dev/ttyUSB0 --station 1 garage.hex",
)

_DIFFERS = 1
# Characters on the wire a byte, by and large: two digits read; in writing also the frames around
# a few bytes, and the reading back.
_CHARS_READ, _CHARS_WRITTEN = 2.3, 12
_BITS_PER_CHAR = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares what is done, to whom, with which file."""
    parser.description = (
        "dump reads all 2,048 bytes into a file. diff compares a file with the module. restore "
        "writes the bytes that differ, and only those, and reads everything back: an "
        "EEPROM wears out with writes. A restore that was interrupted goes on where it ended when "
        "it is called again. Modes and hold times lie in the EEPROM too: a restored module has "
        "those of the file. It goes in Wisco frames: DIP switch 8 ON."
    )
    parser.epilog = "Exit status of diff: 0 when nothing differs, else 1."
    parser.add_argument("action", choices=tuple(_ACTIONS), help="what to do")
    parser.add_argument(
        "words",
        nargs="*",
        default=[],
        metavar="[STATION] FILE",
        help="STATION: its id, without --port. FILE: .hex is Intel HEX, .bin is raw",
    )
    add_flags(parser)
    parser.add_argument("--format", choices=[each.value for each in ImageFormat], help="of FILE")
    parser.add_argument(
        "--broker",
        action="store_true",
        help="dump and diff: have the running bridge read STATION, through the broker",
    )
    parser.add_argument("--yes", action="store_true", help="restore without asking")
    parser.add_argument("--force", action="store_true", help="let dump replace a file")


def run(args: argparse.Namespace) -> int:
    """Gives 0 when done; diff gives 1 where something differs."""
    place, words = find_place(args, args.words)
    path = _file(args.action, words)
    image_format = _format(path, args.format)
    if place.line.protocol is LineProtocol.MODBUS_RTU:
        raise UsageError(
            "the EEPROM is reached in Wisco frames alone: set DIP switch 8 ON, power the module "
            "off and on, and say --protocol wisco"
        )
    return _ACTIONS[args.action](place, path, image_format, args)


def _file(action: str, words: list[str]) -> Path:
    if not words:
        raise UsageError(f"{action} needs a FILE, such as garage.hex")
    if len(words) > 1:
        raise UsageError(f"{words[1]} is one word too many for {action}")
    return Path(words[0])


def _format(path: Path, given: str | None) -> ImageFormat:
    found = ImageFormat(given) if given else format_of(path)
    if found is None:
        raise UsageError(f"{path} does not say its format: name it .hex or .bin, or add --format")
    return found


def _dump(place: Place, path: Path, image_format: ImageFormat, args: argparse.Namespace) -> int:
    if path.exists() and not args.force:
        raise BridgeError(f"{path} is there already: --force replaces it")
    data = _read_all(place, "dump", path, args)
    write_image(path, image_format, data)
    print(f"{place.name}: {len(data)} bytes are in {path}", file=sys.stderr)
    return 0


def _diff(place: Place, path: Path, image_format: ImageFormat, args: argparse.Namespace) -> int:
    wanted = read_image(path, image_format)
    now = _read_all(place, "diff", path, args)
    patches = patches_for(now, wanted)
    for patch in patches:
        print(_shown(patch, now))
    _tell_difference(place, patches, wanted)
    return _DIFFERS if patches else 0


def _restore(place: Place, path: Path, image_format: ImageFormat, args: argparse.Namespace) -> int:
    if args.broker:
        raise UsageError("restore needs the port: the bridge reads an EEPROM, and writes none")
    wanted = read_image(path, image_format)
    with visit(place, None) as met:
        patches = patches_for(_read(met), wanted)
        _tell_difference(place, patches, wanted)
        question = f"write {_size(patches)} bytes to the EEPROM of {place.name}?"
        if patches and confirmed(question, yes=args.yes):
            _write(met, patches, path)
            _verify(met, wanted)
    return 0


def _write(met: Visit, patches: tuple[Patch, ...], path: Path) -> None:
    done = 0

    def count(so_far: int, total: int) -> None:
        nonlocal done
        done = so_far
        show(so_far, total)

    try:
        with _bar(met, "written", _CHARS_WRITTEN, _size(patches)) as show:
            Eeprom(met.bus, met.place.address).write(patches, count)
    except (PortError, ExchangeError) as error:
        raise BridgeError(
            f"{error}; {done} of {_size(patches)} bytes are written and read back: "
            f"restore {path} again, and it goes on from there"
        ) from error


def _verify(met: Visit, wanted: Mapping[int, int]) -> None:
    left = patches_for(_read(met), wanted)
    if left:
        raise NotRestoredError(
            f"{_size(left)} bytes differ after all, the first at {left[0].address:04X}h: does "
            "another program write to this module, or the module itself?"
        )
    told = f"{met.place.name}: restored; all {EEPROM_BYTES} bytes were read back"
    print(told, file=sys.stderr)


def _read_all(place: Place, action: str, path: Path, args: argparse.Namespace) -> bytes:
    """Reads it on the port, or has the bridge read it."""
    if args.broker:
        return read_through_broker(place)
    with visit(place, f"eeprom {action} --broker STATION {shlex.quote(str(path))}") as met:
        return _read(met)


def _read(met: Visit) -> bytes:
    with _bar(met, "read", _CHARS_READ, EEPROM_BYTES) as show:
        return Eeprom(met.bus, met.place.address).read(show)


@contextmanager
def _bar(met: Visit, word: str, chars: float, size: int) -> Iterator[Progress]:
    """Shows how far it is; the time that is left goes by what the wire takes for a byte."""
    byte_s = chars * _BITS_PER_CHAR / met.place.line.baud
    with progress(size * byte_s) as tell:
        yield lambda done, of: tell((of - done) * byte_s, f"{done} of {of} bytes {word}")


def _tell_difference(place: Place, patches: tuple[Patch, ...], wanted: Mapping[int, int]) -> None:
    told = f"{_size(patches)} of {len(wanted)} bytes differ" if patches else "nothing differs"
    print(f"{place.name}: {told}", file=sys.stderr)


def _size(patches: tuple[Patch, ...]) -> int:
    return sum(len(patch.data) for patch in patches)


def _shown(patch: Patch, now: bytes) -> str:
    there = now[patch.address : patch.address + len(patch.data)]
    return f"{patch.address:04X} {there.hex(' ').upper()} -> {patch.data.hex(' ').upper()}"


_ACTIONS = {"dump": _dump, "diff": _diff, "restore": _restore}
