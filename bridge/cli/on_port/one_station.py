"""One module at its port, for one command: named by the configuration or by flags."""

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bridge.cli.frame.usage import UsageError, check_stations
from bridge.cli.on_port.busy import line_at, not_while_it_runs, through_the_bridge
from bridge.clock import boot_s
from bridge.commission.visit import find_model, meet, plain_station
from bridge.config.load import find_config, load_config
from bridge.config.schema import Config, LineConfig, StationConfig
from bridge.errors import PortBusyError
from bridge.line.station import Station
from bridge.model import BAUD_RATES, LAST_ADDRESS, MODULE_TYPES, USUAL_BAUD, LineProtocol
from bridge.transport.bus import Bus, bus_of
from bridge.transport.opener import open_port

_FLAGS = ("station", "protocol", "baud", "model")


@dataclass(frozen=True, slots=True)
class Subject:
    """The module of a command.

    Attributes:
        name: Its name in messages.
        station_config: What is known of it; None: the model has to be found out.
        config: The file that names it, if any.
    """

    name: str
    line: LineConfig
    address: int
    station_config: StationConfig | None
    config: Path | None


@dataclass(frozen=True, slots=True)
class Visit:
    """A module after its contact: it is there, and everything about it was read.

    Attributes:
        ms: The time of the contact.
    """

    place: Subject
    station: Station
    bus: Bus
    ms: int


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Declare the flags that replace a configuration."""
    flags = parser.add_argument_group("without a configuration")
    add = flags.add_argument
    add("--port", metavar="PORT", help="a device, tcp://host:port or rfc2217://host:port")
    add("--station", type=int, metavar="0-31", help="its address; goes with --port")
    add("--protocol", choices=[each.value for each in LineProtocol], help="default: wisco")
    add("--baud", type=int, choices=BAUD_RATES, help="default: 9600")
    add("--model", choices=tuple(MODULE_TYPES), help="default: the module is asked")


def find_place(args: argparse.Namespace, words: list[str]) -> tuple[Subject, list[str]]:
    """Return the module, and the remaining words.

    Raises:
        UsageError: No module is named, or an unknown one.
        ConfigError: The configuration is wrong or missing.
    """
    if args.port is not None:
        return _place_of_flags(args), words
    if given := [f"--{flag}" for flag in _FLAGS if getattr(args, flag) is not None]:
        raise UsageError(f"{given[0]} goes with --port; or name a station of the configuration")
    if not words:
        raise UsageError("name a station of the configuration, or give --port and --station")
    path = find_config(args.config)
    config = load_config(path, os.environ, secrets=False)
    check_stations(words[:1], config)
    return place_in(config, words[0], path), words[1:]


def place_in(config: Config, name: str, path: Path) -> Subject:
    """Return the module of a station of the configuration at `path`."""
    line, station_config = next(found for found in config.all_stations if found[1].id == name)
    return Subject(name, line, station_config.address, station_config, path)


def _place_of_flags(args: argparse.Namespace) -> Subject:
    address, protocol = args.station, LineProtocol(args.protocol or LineProtocol.WISCO)
    if address is None:
        raise UsageError("--port goes with --station: say which module")
    if not 0 <= address <= LAST_ADDRESS:
        raise UsageError(f"station {address} is not one of 0-{LAST_ADDRESS}")
    if address == 0 and protocol is not LineProtocol.WISCO:
        raise UsageError("in Modbus, 0 is no station but all of them: give 1-31")
    config = None if args.model is None else plain_station(address, MODULE_TYPES[args.model])
    line = LineConfig("line", args.port, args.baud or USUAL_BAUD, protocol, ())
    return Subject(f"station {address}", line, address, config, config=None)


@contextmanager
def visit(place: Subject, through_broker: str | None) -> Iterator[Visit]:
    """Open the port and contact the module.

    `through_broker` is the command that does the same while the bridge has the port: a command line
    without its beginning, with STATION in place of the station id. None: there is no such command.

    Raises:
        NotMetError: There is no answer, or another module answers.
        PortError: The port cannot be opened, or is gone.
    """
    line, began = place.line, boot_s()
    try:
        port = open_port(line.port, line.baud)
    except PortBusyError as error:
        raise _with_offer(error, place, through_broker) from error
    try:
        config = place.station_config
        if config is None:
            config = plain_station(place.address, find_model(port, line, place.address))
        bus = bus_of(line, port)
        bus.await_silence()
        station = Station(config, line)
        meet(station, line, bus, boot_s)
        yield Visit(place, station, bus, round((boot_s() - began) * 1000))
    finally:
        port.close()


def _with_offer(error: PortBusyError, place: Subject, command: str | None) -> PortBusyError:
    if command is None:
        return not_while_it_runs(error)
    path, name = (place.config, place.name) if place.config else _configured(place)
    return through_the_bridge(error, command.replace("STATION", name), path)


def _configured(place: Subject) -> tuple[Path | None, str]:
    """Return the configuration file and the id of the station that the flags name, if found."""
    path, line = line_at(place.line.port, None)
    for config in line.stations if line else ():
        if config.address == place.address:
            return path, config.id
    return None, "STATION"
