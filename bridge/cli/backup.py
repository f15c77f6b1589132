"""`wisco2mqtt backup`: configuration, counts and what every module holds, in one file."""

import argparse
import sys
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from bridge import __version__
from bridge.cli.frame.interrupt import saying
from bridge.cli.frame.service import load_with_state
from bridge.cli.on_port.memory import read_eeprom, read_settings
from bridge.cli.on_port.one_station import Visit, place_in, visit
from bridge.commission.cabinet import Cabinet, KeptModule, content_of, write_cabinet
from bridge.commission.image import image_text
from bridge.commission.settings_file import format_settings
from bridge.commission.visit import NotMetError
from bridge.config.load import find_config
from bridge.config.schema import Config
from bridge.errors import BridgeError, ExchangeError
from bridge.files import read_file
from bridge.model import LineProtocol

NAME = "backup"
EXAMPLES = ("backup cabinet.zip",)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the file."""
    parser.description = (
        "Writes one zip: the configuration as it is (with the secrets that stand in it: only its "
        "owner can read the file), the counts, and of every module its modes, hold times and "
        "EEPROM. It reads on the ports, so the bridge has to be stopped meanwhile; nothing is "
        "written to a module. On a line of Modbus RTU the EEPROM is out of reach, and is left out. "
        "A module that does not answer is named, and the exit status is 1."
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="such as cabinet.zip")
    parser.add_argument("--force", action="store_true", help="replace a file that is there")


def run(args: argparse.Namespace) -> int:
    """Return 0 when every module is in the backup, else 1."""
    path: Path = args.file
    if path.exists() and not args.force:
        raise BridgeError(f"{path} is there already: --force replaces it")
    config_path = find_config(args.config)
    config = load_with_state(config_path)
    left_out: list[str] = []
    with saying(lambda: f"{path} is not written"):
        modules = tuple(_modules(config, config_path, f"{path} is not written", left_out))
    cabinet = Cabinet(
        made=datetime.now().astimezone().isoformat(timespec="seconds"),
        version=__version__,
        config=read_file(config_path),
        counts=content_of(config.state_file("counts")),
        modules=modules,
    )
    write_cabinet(path, cabinet)
    for told in left_out:
        print(told, file=sys.stderr)
    counts = "counts" if cabinet.counts else "no counts (there are none)"
    told = f"{path}: configuration, {counts}, {len(modules)} modules"
    print(told, file=sys.stderr)
    return 1 if left_out else 0


def _modules(config: Config, path: Path, stopped: str, left_out: list[str]) -> Iterator[KeptModule]:
    """Read all modules; one that does not answer is told in `left_out`.

    Raises:
        PortError: A port is not there, or another program has it.
        NotMetError: No module answers.
    """
    silent = None
    for _, station_config in config.all_stations:
        try:
            with visit(place_in(config, station_config.id, path), None) as met:
                yield _kept(met, stopped, left_out)
        except (NotMetError, ExchangeError) as error:
            left_out.append(f"{station_config.id} is left out: {error}")
            silent = error
    if silent and len(left_out) == sum(1 for _ in config.all_stations):
        raise silent


def _kept(met: Visit, stopped: str, left_out: list[str]) -> KeptModule:
    name, model = met.place.name, met.station.config.model
    settings = image = None
    if met.place.address:  # in Modbus, 0 is no station
        try:
            settings = format_settings(name, model, read_settings(met))
        except BridgeError as error:
            left_out.append(f"modes and hold times of {name} are left out: {error}")
    if met.place.line.protocol is not LineProtocol.MODBUS_RTU:
        image = image_text(read_eeprom(met, stopped), model)
    return KeptModule(name, model, settings, image)
