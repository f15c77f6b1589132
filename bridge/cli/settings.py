"""`wisco2mqtt settings`: shows, compares and applies modes and hold times as YAML."""

import argparse
import sys
from pathlib import Path

from bridge.cli.frame.confirm import confirmed
from bridge.cli.frame.interrupt import saying
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.one_station import Visit, add_flags, find_place, visit
from bridge.commission.settings import Change, SettingsAccess, WantedOutput, changes_for
from bridge.commission.settings_file import format_settings, load_settings
from bridge.drivers.modbus import ModbusDriver
from bridge.errors import BridgeError, NoReplyError
from bridge.model import LineProtocol, OutputSettings

NAME = "settings"
HELP = "modes and hold times of one module as YAML: show, diff, apply"
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


def _show(met: Visit, _path: Path | None, _args: argparse.Namespace) -> int:
    place = met.place
    where = f"{place.line.baud} baud, {place.line.protocol}"
    title = f"{place.name}: station {place.address}, {where}" if place.config else where
    settings = _read(met)
    print(format_settings(title, met.station.config.model, settings), end="")
    return 0


def _diff(met: Visit, path: Path | None, _args: argparse.Namespace) -> int:
    _, _, changes = _compare(met, path)
    for change in changes:
        print(change)
    return _DIFFERS if changes else 0


def _apply(met: Visit, path: Path | None, args: argparse.Namespace) -> int:
    now, wanted, changes = _compare(met, path)
    for change in changes:
        print(change)
    if not changes:
        print(f"{met.place.name} has these settings: nothing is written", file=sys.stderr)
        return 0
    if not confirmed(f"write this to {met.place.name}?", yes=args.yes):
        return 0
    count = _write(met, now, wanted)
    print(f"{met.place.name}: {count} registers written, and read back", file=sys.stderr)
    return 0


def _write(met: Visit, now: OutputSettings, wanted: tuple[WantedOutput, ...]) -> int:
    done = 0

    def count() -> None:
        nonlocal done
        done += 1

    with saying(lambda: f"{done} registers are written to {met.place.name}: apply does the rest"):
        return _access(met).apply(now, wanted, count)


def _compare(
    met: Visit, path: Path | None
) -> tuple[OutputSettings, tuple[WantedOutput, ...], tuple[Change, ...]]:
    wanted = load_settings(path or Path(), met.station.config.model)
    now = _read(met)
    return now, wanted, changes_for(now, wanted)


def _read(met: Visit) -> OutputSettings:
    try:
        return _access(met).read()
    except NoReplyError as error:
        # It was contacted a moment ago, so it is there.
        raise BridgeError(
            f"{met.place.name} answers no Modbus frames, and its settings go in them alone: is it "
            "a module that speaks Wisco only?"
        ) from error


def _access(met: Visit) -> SettingsAccess:
    rtu = met.place.line.protocol is LineProtocol.MODBUS_RTU
    framing = LineProtocol.MODBUS_RTU if rtu else LineProtocol.MODBUS_ASCII
    model = met.station.config.model
    return SettingsAccess(met.bus, ModbusDriver(met.place.address, model, framing))


_ACTIONS = {"show": _show, "diff": _diff, "apply": _apply}
