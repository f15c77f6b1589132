"""`wisco2mqtt settings`: shows, compares and applies modes and hold times as YAML."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from bridge.cli.frame.confirm import confirmed
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.memory import read_settings, write_settings
from bridge.cli.on_port.one_station import Visit, add_flags, find_place, visit
from bridge.commission.settings import Change, WantedOutput, changes_for
from bridge.commission.settings_file import format_settings, load_settings, settings_document
from bridge.model import OutputSettings

NAME = "settings"
EXAMPLES = (
    "settings show garage > garage.yaml",
    "settings diff garage garage.yaml",
    "settings apply --port /dev/ttyUSB0 --station 1 garage.yaml",
)

_DIFFERS = 1
# Values that the bridge publishes and accepts too.
_THROUGH_BROKER = {
    "show": "watch STATION",
    "diff": "watch STATION",
    "apply": "send STATION do/1/mode pulse",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the action, the module and the file."""
    parser.description = (
        "show prints modes and hold times as YAML. diff compares a file with the module. apply "
        "writes what differs, and only that, and reads it back: the settings lie in the "
        "module's EEPROM, which wears out with writes. A file may leave out what is to stay as it "
        "is. On a Wisco line this goes in Modbus ASCII frames, which the same module answers."
    )
    parser.epilog = "Exit status of diff: 0 when nothing differs, else 1."
    parser.add_argument("action", choices=tuple(_ACTIONS), help="what to do")
    parser.add_argument(
        "words",
        nargs="*",
        default=[],
        metavar="[STATION] [FILE]",
        help="STATION: its id, without --port. FILE: for diff and apply",
    )
    add_flags(parser)
    parser.add_argument("--yes", action="store_true", help="apply without asking")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Return 0 when done; diff returns 1 if something differs."""
    place, words = find_place(args, args.words)
    path = _file(args.action, words)
    if place.address == 0:
        raise UsageError("station 0 has no settings to reach: in Modbus it is the broadcast")
    with visit(place, _THROUGH_BROKER[args.action]) as met:
        return _ACTIONS[args.action](met, path, args)


def _file(action: str, words: list[str]) -> Path | None:
    wanted = 0 if action == "show" else 1
    if len(words) > wanted:
        raise UsageError(f"{words[wanted]} is one word too many for {action}")
    if len(words) < wanted:
        raise UsageError(f"{action} needs a FILE, such as one that show has printed")
    return Path(words[0]) if words else None


def _show(met: Visit, _path: Path | None, args: argparse.Namespace) -> int:
    place = met.place
    if args.json:
        print(json.dumps(settings_document(met.station.config.model, read_settings(met))))
        return 0
    where = f"{place.line.baud} baud, {place.line.protocol}"
    title = f"{place.name}: station {place.address}, {where}" if place.config else where
    settings = read_settings(met)
    print(format_settings(title, met.station.config.model, settings), end="")
    return 0


def _diff(met: Visit, path: Path | None, args: argparse.Namespace) -> int:
    _, _, changes = _compare(met, path)
    if args.json:
        print(json.dumps({"changes": [asdict(change) for change in changes]}))
    else:
        for change in changes:
            print(change)
    return _DIFFERS if changes else 0


def _apply(met: Visit, path: Path | None, args: argparse.Namespace) -> int:
    now, wanted, changes = _compare(met, path)
    for change in changes:
        print(change, file=sys.stderr if args.json else sys.stdout)
    count = 0
    if not changes:
        print(f"{met.place.name} has these settings: nothing is written", file=sys.stderr)
    elif confirmed(f"write this to {met.place.name}?", yes=args.yes):
        count = write_settings(met, now, wanted, "apply")
    if args.json:
        document = {"changes": [asdict(change) for change in changes], "registers_written": count}
        print(json.dumps(document))
    if count:
        print(f"{met.place.name}: {count} registers written, and read back", file=sys.stderr)
    return 0


def _compare(
    met: Visit, path: Path | None
) -> tuple[OutputSettings, tuple[WantedOutput, ...], tuple[Change, ...]]:
    wanted = load_settings(path or Path(), met.station.config.model)
    now = read_settings(met)
    return now, wanted, changes_for(now, wanted)


_ACTIONS = {"show": _show, "diff": _diff, "apply": _apply}
