"""`wisco2mqtt restore`: shows what a backup has otherwise, asks, and writes only that."""

import argparse
import difflib
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from bridge.cli.frame.confirm import confirmed
from bridge.cli.frame.interrupt import saying
from bridge.cli.frame.locks import BaseTopicLocks
from bridge.cli.frame.service import config_with_state, load_with_state
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.memory import (
    read_eeprom,
    read_settings,
    size_of,
    verify_eeprom,
    write_eeprom,
    write_settings,
)
from bridge.cli.on_port.one_station import Subject, Visit, place_in, visit
from bridge.commission.cabinet import Cabinet, KeptModule, content_of, read_cabinet
from bridge.commission.eeprom import Patch, patches_for
from bridge.commission.settings import Change, changes_for
from bridge.config.load import SEARCHED, find_config
from bridge.config.schema import Config
from bridge.config.without_secrets import HIDDEN, with_secrets, without_secrets
from bridge.errors import BridgeError, ConfigError
from bridge.files import replace_file
from bridge.model import LineProtocol
from bridge.transport.lock import LockHeldError

NAME = "restore"
EXAMPLES = ("restore cabinet.zip", "restore cabinet.zip garage")

_NOTHING = "nothing is written"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the file, and the modules."""
    parser.description = (
        "Compares a backup with the configuration, the counts and the modules that are there, "
        "shows what differs, asks once, and writes only that; everything is read back. With "
        "stations named, only those modules. Modules are found as the present configuration says, "
        "or, where there is none, as that of the backup. The bridge has to be stopped meanwhile. "
        "A restore that was interrupted goes on where it ended when it is called again."
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="what backup has written")
    parser.add_argument(
        "stations", nargs="*", default=[], metavar="STATION", help="only these modules"
    )
    parser.add_argument("--yes", action="store_true", help="write without asking")


@dataclass(frozen=True, slots=True)
class _File:
    """A file that is to have another content; what was there before is kept beside it."""

    path: Path
    wanted: bytes
    mode: int

    def differs(self) -> bool:
        return content_of(self.path) != self.wanted

    def write(self) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        owner = (self.path if self.path.exists() else self.path.parent).stat()
        mode = owner.st_mode & 0o777 if self.path.exists() else self.mode
        if (before := content_of(self.path)) is not None:
            replace_file(self.path.with_name(f"{self.path.name}.before"), before, mode)
        replace_file(self.path, self.wanted, mode)
        if os.geteuid() == 0:  # the service reads it as the user that it was
            os.chown(self.path, owner.st_uid, owner.st_gid)


@dataclass(frozen=True, slots=True)
class _Difference:
    """What one module has otherwise than the backup."""

    kept: KeptModule
    place: Subject
    changes: tuple[Change, ...]
    patches: tuple[Patch, ...]


def run(args: argparse.Namespace) -> int:
    """Return 0 when everything is as in the backup, or the person said no."""
    path: Path = args.file
    cabinet = read_cabinet(path)
    print(f"{path}: made {cabinet.made} by wisco2mqtt {cabinet.version}", file=sys.stderr)
    kept = _chosen(cabinet, args.stations, path)
    with BaseTopicLocks() as locks:
        with saying(lambda: _NOTHING):
            config_path, config, places = _house(cabinet, args.config)
            _take(locks, config)
            files = [] if args.stations else list(_files(cabinet, config_path, config))
            modules = list(_differences(kept, places))
            wanted = bool(files or modules) and confirmed(
                "write what the backup has?", yes=args.yes, otherwise=_NOTHING
            )
        if not files and not modules:
            print("nothing differs", file=sys.stderr)
        if wanted:
            for file in files:
                _write_file(file)
            for difference in modules:
                _write_module(difference, f"restore {path}")
    return 0


def _chosen(cabinet: Cabinet, names: list[str], path: Path) -> list[KeptModule]:
    known = [kept.station_id for kept in cabinet.modules]
    for name in names:
        if name not in known:
            listed = ", ".join(known) or "none"
            raise UsageError(f"there is no station {name} in {path}; there are: {listed}")
    return [kept for kept in cabinet.modules if not names or kept.station_id in names]


def _house(cabinet: Cabinet, given: Path | None) -> tuple[Path, Config, dict[str, Subject]]:
    """Return where the configuration belongs, the one that counts, and where the modules are."""
    try:
        path = find_config(given)
    except ConfigError:
        path = SEARCHED[-1]  # there is none: it goes to its usual place
    kept = cabinet.config.decode("utf-8-sig", "replace")
    configs = [
        *_readable(str(path), lambda: load_with_state(path)),
        *_readable("the backup", lambda: config_with_state(kept, path)),
    ]
    if not configs:
        raise BridgeError("neither configuration can be read: nothing says where the modules are")
    places = {
        station_config.id: place_in(config, station_config.id, path)
        for config in reversed(configs)  # what is there now counts more than what was
        for _, station_config in config.all_stations
    }
    return path, configs[0], places


def _readable(whose: str, load: Callable[[], Config]) -> Iterator[Config]:
    try:
        yield load()
    except ConfigError as error:
        told = f"the configuration of {whose} is not used to find modules: {error.problems[0]}"
        print(told, file=sys.stderr)


def _take(locks: BaseTopicLocks, config: Config) -> None:
    try:
        locks.acquire(config.mqtt.base_topic)
    except LockHeldError as error:
        raise BridgeError(
            "the bridge runs, and would go on with what it has: "
            "sudo systemctl stop wisco2mqtt, and start it afterwards"
        ) from error


def _files(cabinet: Cabinet, config_path: Path, config: Config) -> Iterator[_File]:
    """Show which files differ, and return them."""
    files = [
        (_File(config_path, _with_secrets(cabinet.config, config_path), 0o644), cabinet.config)
    ]
    if cabinet.counts is not None:
        files.append((_File(config.state_file("counts"), cabinet.counts, 0o600), cabinet.counts))
    for file, kept in files:
        if file.differs():
            print(f"{file.path} differs:")
            _show_text(content_of(file.path) or b"", kept, file.path)
            yield file


def _with_secrets(wanted: bytes, path: Path) -> bytes:
    """Return the configuration of a backup; of secrets that it hides, those that are there.

    Raises:
        ConfigError: They are not: they have to be written.
    """
    if HIDDEN not in (text := wanted.decode("utf-8-sig", "replace")):
        return wanted  # the present file need not even be readable
    now = (content_of(path) or b"{}").decode("utf-8-sig", "replace")
    return with_secrets(text, now, f"{path} of the backup").encode()


def _show_text(now: bytes, wanted: bytes, path: Path) -> None:
    old, new = (_shown(content, path).splitlines() for content in (now, wanted))
    lines = list(difflib.unified_diff(old, new, n=0, lineterm=""))[2:]
    for line in lines or ["(a secret)"]:
        if not line.startswith("@@"):
            print(f"  {line}")


def _shown(content: bytes, path: Path) -> str:
    try:
        return without_secrets(content.decode("utf-8-sig"), str(path))
    except (ConfigError, UnicodeDecodeError):
        return ""  # it cannot be told what in it is secret


def _differences(kept: list[KeptModule], places: dict[str, Subject]) -> Iterator[_Difference]:
    """Show what modules have otherwise, and return it."""
    for each in kept:
        if each.station_id not in places:
            raise BridgeError(f"no configuration says where {each.station_id} is: name the others")
        with visit(places[each.station_id], None) as met:
            found = _compare(each, met)
        for change in found.changes:
            print(f"{each.station_id} {change}")
        if found.patches:
            print(f"{each.station_id}: {size_of(found.patches)} bytes of the EEPROM differ")
        if found.changes or found.patches:
            yield found


def _compare(kept: KeptModule, met: Visit) -> _Difference:
    changes = changes_for(read_settings(met), kept.wanted()) if kept.settings else ()
    return _Difference(kept, met.place, changes, _patches(kept, met))


def _patches(kept: KeptModule, met: Visit) -> tuple[Patch, ...]:
    if kept.image is None:
        return ()
    if met.place.line.protocol is LineProtocol.MODBUS_RTU:
        told = "its EEPROM is not compared: Modbus RTU does not reach it"
        print(f"{kept.station_id}: {told}", file=sys.stderr)
        return ()
    return patches_for(read_eeprom(met, _NOTHING), kept.content())


def _write_file(file: _File) -> None:
    try:
        file.write()
    except OSError as error:
        raise BridgeError(f"{file.path} cannot be written: {error.strerror}") from error
    print(f"{file.path} is written", file=sys.stderr)


def _write_module(difference: _Difference, again: str) -> None:
    kept = difference.kept
    with visit(difference.place, None) as met:
        if difference.changes:
            write_settings(met, read_settings(met), kept.wanted(), again)
        # The modes and hold times lie in the EEPROM too: what is left of it is compared anew.
        if patches := _patches(kept, met):
            write_eeprom(met, patches, again)
            verify_eeprom(met, kept.content(), f"{again} tells whether it is there")
    print(f"{kept.station_id}: restored, and read back", file=sys.stderr)
