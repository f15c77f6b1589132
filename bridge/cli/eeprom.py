"""`wisco2mqtt eeprom`: saves the EEPROM of one module, compares it with a file, restores it."""

import argparse
import json
import shlex
import sys
from pathlib import Path
from typing import Any

from bridge.cli.frame.confirm import confirmed
from bridge.cli.frame.interrupt import saying
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.memory import read_eeprom, size_of, verify_eeprom, write_eeprom
from bridge.cli.on_port.one_station import Subject, Visit, add_flags, find_place, visit
from bridge.cli.through_broker.eeprom_broker import read_through_broker
from bridge.commission.eeprom import Patch, patches_for
from bridge.commission.image import Image, ImageFormat, format_of, read_image, write_image
from bridge.errors import BridgeError
from bridge.model import MODULE_TYPES, LineProtocol, ModuleType
from bridge.protocol.wisco_eeprom import EEPROM_BYTES

NAME = "eeprom"
EXAMPLES = (
    "eeprom dump garage garage.hex",
    "eeprom diff garage garage.hex",
    "eeprom restore --port /dev/ttyUSB0 --station 1 garage.hex",
)

_DIFFERS = 1
_NOTHING_WRITTEN = "nothing is written to the module"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the action, the module and the file."""
    parser.description = (
        "dump reads all 2,048 bytes into a file. diff compares a file with the module. restore "
        "writes the bytes that differ, and only those, and reads everything back: an "
        "EEPROM wears out with writes. A restore that was interrupted goes on where it ended when "
        "it is called again. Modes and hold times lie in the EEPROM too: a restored module has "
        "those of the file. A .hex file says of which model it was, and no module of the other one "
        "takes it; for a file that does not say so, --from does. It goes in Wisco frames: DIP "
        "switch 8 ON."
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
    parser.add_argument(
        "--from",
        dest="origin",
        choices=tuple(MODULE_TYPES),
        help="restore: the model that FILE was read from, where FILE does not say it (.bin)",
    )
    parser.add_argument("--yes", action="store_true", help="restore without asking")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--force",
        action="store_true",
        help="let dump replace a file, and restore write one of another model, or a part of a .bin",
    )


def run(args: argparse.Namespace) -> int:
    """Return 0 when done; diff returns 1 if something differs."""
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


def _dump(place: Subject, path: Path, image_format: ImageFormat, args: argparse.Namespace) -> int:
    if path.exists() and not args.force:
        raise BridgeError(f"{path} is there already: --force replaces it")
    data, model = _read_all(place, "dump", path, args, f"{path} is not written")
    write_image(path, image_format, data, model)
    print(f"{place.name}: {len(data)} bytes are in {path}", file=sys.stderr)
    if args.json:
        print(json.dumps({"file": str(path), "model": model.name, "bytes": len(data)}))
    return 0


def _diff(place: Subject, path: Path, image_format: ImageFormat, args: argparse.Namespace) -> int:
    image = read_image(path, image_format, partial=args.force)
    now, model = _read_all(place, "diff", path, args, "nothing is compared")
    if told := _mix_up(place, model, image.model, path):
        print(told, file=sys.stderr)
    patches = patches_for(now, image.content)
    if args.json:
        print(json.dumps(_document(patches, now, image)))
    else:
        for patch in patches:
            print(_shown(patch, now))
    _tell_difference(place, patches, image)
    return _DIFFERS if patches else 0


def _restore(
    place: Subject, path: Path, image_format: ImageFormat, args: argparse.Namespace
) -> int:
    if args.broker:
        raise UsageError("restore needs the port: the bridge reads an EEPROM, and writes none")
    image = read_image(path, image_format, partial=args.force)
    origin = _origin(image, path, args)
    written = 0
    with visit(place, None) as met:
        told = _mix_up(place, met.station.config.model, origin, path)
        if told and not args.force:
            raise BridgeError(f"{told}: nothing is written (--force writes it even so)")
        patches = patches_for(read_eeprom(met, _NOTHING_WRITTEN), image.content)
        _tell_difference(place, patches, image)
        question = f"write {size_of(patches)} bytes to the EEPROM of {place.name}?"
        if patches and _may(question, yes=args.yes):
            write_eeprom(met, patches, f"restore {path}")
            _verify(met, image)
            written = size_of(patches)
    if args.json:
        print(json.dumps({"file": str(path), "differing": size_of(patches), "written": written}))
    return 0


def _may(question: str, *, yes: bool) -> bool:
    with saying(lambda: _NOTHING_WRITTEN):
        return confirmed(question, yes=yes)


def _origin(image: Image, path: Path, args: argparse.Namespace) -> ModuleType | None:
    """Return the model that a file was read from, by its content or by --from.

    None with --force: then it does not matter.
    """
    said = None if args.origin is None else MODULE_TYPES[args.origin]
    if said and image.model and said != image.model:
        raise UsageError(f"{path} says itself that it is of a {image.model.name}: leave --from out")
    origin = image.model or said
    if origin is None and not args.force:
        models = " or ".join(f"--from {name}" for name in MODULE_TYPES)
        raise UsageError(f"{path} does not say which model it was read from: add {models}")
    return origin


def _mix_up(place: Subject, model: ModuleType, origin: ModuleType | None, path: Path) -> str:
    """Return why a file does not fit a module of this model, or None."""
    if origin is None or origin == model:
        return ""
    return f"{path} is the EEPROM of a {origin.name}, and {place.name} is a {model.name}"


def _verify(met: Visit, image: Image) -> None:
    verify_eeprom(met, image.content, "all is written; diff tells whether it is there")
    told = f"{met.place.name}: restored; all {EEPROM_BYTES} bytes were read back"
    print(told, file=sys.stderr)


def _read_all(
    place: Subject, action: str, path: Path, args: argparse.Namespace, stopped: str
) -> tuple[bytes, ModuleType]:
    """Return the EEPROM and the model, read on the port or by the bridge."""
    if args.broker:
        with saying(lambda: stopped):
            return read_through_broker(place)
    with visit(place, f"eeprom {action} --broker STATION {shlex.quote(str(path))}") as met:
        return read_eeprom(met, stopped), met.station.config.model


def _tell_difference(place: Subject, patches: tuple[Patch, ...], image: Image) -> None:
    size = len(image.content)
    told = f"{size_of(patches)} of {size} bytes differ" if patches else "nothing differs"
    print(f"{place.name}: {told}", file=sys.stderr)


def _document(patches: tuple[Patch, ...], now: bytes, image: Image) -> dict[str, Any]:
    listed = [
        {
            "address": patch.address,
            "module": now[patch.address : patch.address + len(patch.data)].hex(),
            "file": patch.data.hex(),
        }
        for patch in patches
    ]
    return {"differing": size_of(patches), "of": len(image.content), "patches": listed}


def _shown(patch: Patch, now: bytes) -> str:
    there = now[patch.address : patch.address + len(patch.data)]
    return f"{patch.address:04X} {there.hex(' ').upper()} -> {patch.data.hex(' ').upper()}"


_ACTIONS = {"dump": _dump, "diff": _diff, "restore": _restore}
