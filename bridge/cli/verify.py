"""`wisco2mqtt verify`: measures what real modules do, against what the bridge assumes."""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from bridge.cli.frame.arguments import addresses
from bridge.cli.frame.confirm import confirmed
from bridge.cli.frame.terminal import progress
from bridge.cli.frame.usage import UsageError, check_stations
from bridge.cli.on_port.busy import line_at, through_the_bridge
from bridge.cli.scan import check_writable, write_proposal
from bridge.cli.through_broker.verify_line import verify_line
from bridge.cli.views.verify_report import print_document
from bridge.commission.findings import Found
from bridge.commission.proposal import configuration
from bridge.commission.scan import Scan
from bridge.commission.survey import STATIONS, effort_at, format_stations, survey_of
from bridge.commission.verify.assumptions import ASSUMPTIONS
from bridge.commission.verify.line import OwnLine
from bridge.commission.verify.verification import (
    SAMPLES,
    Module,
    Verification,
    fails,
    modules_of,
    patient,
    unheard,
)
from bridge.commission.visit import silent
from bridge.config.load import find_config, load_config
from bridge.config.schema import LineConfig
from bridge.errors import BridgeError, ConfigError, PortBusyError
from bridge.model import BAUD_RATES, LineProtocol
from bridge.transport.opener import open_port
from bridge.transport.port import Port

NAME = "verify"
EXAMPLES = (
    "verify /dev/ttyUSB0 --baud 9600 --stations 1-2",
    "verify garage --json",
    "verify garage --output 2 --yes",
)

_LEAST_SAMPLES, _MOST_SAMPLES = 20, 10_000


@dataclass(frozen=True, slots=True)
class _Target:
    """Describe what is verified; no modules: the port is to be searched."""

    line: LineConfig
    modules: Sequence[Module]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where the modules are, how often they are asked, and what becomes of it."""
    parser.usage = "%(prog)s {PORT | STATION | --line LINE} [options]"
    parser.description = (
        "Tells of each assumption about the modules (docs/protocol.md, Readings): as assumed, "
        "differs, or not tried, and why. It measures the turnaround, the silence that they need, "
        "late replies and the error rate of the cable, and ends with the settings of the line that "
        "follow. It reads alone, unless --output names an output in pulse mode that may be "
        "switched."
    )
    parser.epilog = (
        "Exit status: 0, or 1 where a module does not answer, or differs in what the bridge relies "
        "on."
    )
    add = parser.add_argument
    add("place", metavar="PORT | STATION", nargs="?", help="a port, or a station of the file")
    add("--line", metavar="LINE", help="the running bridge does it on this line, between its polls")
    add("--baud", type=int, choices=BAUD_RATES, help="with PORT; default: 9600")
    add("--protocol", choices=[each.value for each in LineProtocol], help="default: wisco")
    add("--stations", type=addresses, metavar="1-8,12", help="only these addresses")
    add(
        "--samples",
        type=_samples,
        default=SAMPLES,
        metavar="N",
        help=f"how often each module is asked, for timing and errors (default: {SAMPLES})",
    )
    add("--output", type=int, metavar="N", help="switch this output of the one module, too")
    add("--yes", action="store_true", help="switch it without asking")
    add("--write", type=Path, metavar="FILE", help="with PORT: write a configuration of it all")
    add("--force", action="store_true", help="let --write replace a file that is there")
    add("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Verify; gives 1 where something differs that the bridge relies on."""
    if (args.place is None) is (args.line is None):
        raise UsageError("give a PORT, a STATION, or --line with a line of the configuration")
    document = _on_port(args) if args.line is None else verify_line(args)
    print_document(document, as_json=args.json)
    return _status(document, args.stations)


def _status(document: Mapping[str, Any], wanted: tuple[int, ...] | None) -> int:
    missing = {*(wanted or ())} - {station["address"] for station in document["stations"]}
    if absent := unheard(document):
        print(f"no answer: {', '.join(absent)}", file=sys.stderr)
    wrong = fails(document)
    for who, name in wrong:
        print(
            f"{who} differs in {name}, on which the bridge relies: {ASSUMPTIONS[name].taken}",
            file=sys.stderr,
        )
    return 1 if wrong or absent or missing else 0


def _on_port(args: argparse.Namespace) -> Mapping[str, Any]:
    place = _place(args)
    if args.write is not None:
        if not _is_port(args.place):
            raise UsageError("--write goes with a PORT: a configuration is there already")
        check_writable(args.write, force=args.force)
    modules = place.modules or _search(args, place.line)
    _check_output(args, modules)
    work = Verification(place.line, modules, args.samples, args.output)
    port = _open(args, place.line, place.line.baud)
    try:
        with progress(work.total_s) as tell:
            document = work.run(
                OwnLine(port, patient(place.line)),
                lambda told: tell((1 - told["progress"]) * work.total_s, str(told["at"])),
            )
    finally:
        port.close()
    if len(unheard(document)) == len(modules):
        raise BridgeError(silent(place.line, modules[0].address))
    if args.write is not None:
        timings = [f"{one['name']}: {one['value']}" for one in document["settings"]]
        found = [_found(place.line, module) for module in modules]
        text = configuration(place.line.port, found, (), timings)
        write_proposal(args.write, text, force=args.force)
    return document


def _is_port(word: str) -> bool:
    return "/" in word or "\\" in word


def _place(args: argparse.Namespace) -> _Target:
    """Return what the command line names."""
    if not _is_port(args.place):
        return _configured(args)
    protocol = LineProtocol(args.protocol or LineProtocol.WISCO)
    baud = args.baud or BAUD_RATES[1]
    known = None
    if args.baud is None and args.protocol is None:
        _, known = line_at(args.place, args.config)
    if known is not None:
        modules = modules_of(known, args.stations or STATIONS)
        if modules:
            return _Target(known, modules)
    return _Target(LineConfig("line", args.place, baud, protocol, ()), ())


def _configured(args: argparse.Namespace) -> _Target:
    if given := [f"--{flag}" for flag in ("baud", "protocol", "stations") if getattr(args, flag)]:
        raise UsageError(f"{given[0]} goes with a PORT: the configuration says it of {args.place}")
    config = load_config(find_config(args.config), os.environ)
    check_stations([args.place], config)
    (place,) = (
        _Target(line, [Module(station_config.address, station_config.model, station_config.id)])
        for line in config.lines
        for station_config in line.stations
        if station_config.id == args.place
    )
    return place


def _search(args: argparse.Namespace, line: LineConfig) -> list[Module]:
    # Named ones are asked four times: they should be there.
    effort = effort_at(line.port, thorough=args.stations is not None)
    survey = survey_of([line.baud], [line.protocol], args.stations or STATIONS, effort)
    scan = Scan(survey, partial(_open, args, line), lambda _: None)
    scan.run(len(args.stations) if args.stations else None)
    found = sorted(scan.findings.found, key=lambda one: one.address)
    if not found:
        raise BridgeError(
            f"no module answers {line.protocol} at {line.baud} baud on {line.port}: "
            f"`wisco2mqtt scan {line.port}` finds out who does"
        )
    missing = {*(args.stations or ())} - {one.address for one in found}
    for address in sorted(missing):
        print(f"station {address} does not answer: it is left out", file=sys.stderr)
    return [Module(one.address, one.model, f"station {one.address}") for one in found]


def _check_output(args: argparse.Namespace, modules: Sequence[Module]) -> None:
    if args.output is None:
        return
    if len(modules) != 1:
        raise UsageError("--output goes with one module: name it, or give --stations N")
    (module,) = modules
    if not 1 <= args.output <= module.model.outputs:
        raise UsageError(f"{module.name} is a {module.model.name} and has no do/{args.output}")
    if not confirmed(f"switch do/{args.output} of {module.name}, four times?", yes=args.yes):
        raise BridgeError("nothing was done")


def _open(args: argparse.Namespace, line: LineConfig, baud: int) -> Port:
    try:
        return open_port(line.port, baud)
    except PortBusyError as error:
        path, known = line_at(line.port, args.config)
        with suppress(ConfigError):
            path = path or find_config(args.config)
        words = f"verify --line {known.id if known else 'LINE'}"
        if args.stations:
            words += f" --stations {format_stations(args.stations)}"
        raise through_the_bridge(error, words, path) from error


def _found(line: LineConfig, module: Module) -> Found:
    return Found(module.address, module.model, line.baud, (line.protocol,), None, 0, 0)


def _samples(text: str) -> int:
    count = int(text) if text.isascii() and text.isdecimal() else 0
    if not _LEAST_SAMPLES <= count <= _MOST_SAMPLES:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no count: write {_LEAST_SAMPLES} to {_MOST_SAMPLES}"
        )
    return count
