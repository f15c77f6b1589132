"""`verify --line`: has the bridge verify the modules of a line of its own, between its polls."""

import argparse
import os
from collections.abc import Mapping
from typing import Any

from bridge.cli.frame.interrupt import StoppedError
from bridge.cli.frame.terminal import progress
from bridge.cli.frame.usage import UsageError
from bridge.cli.through_broker.ask_bridge import asked, line_named
from bridge.commission.survey import STATIONS, format_stations
from bridge.commission.verify.verification import Verification, modules_of
from bridge.config.load import find_config, load_config
from bridge.errors import BridgeError
from bridge.line.errand import SHARE

# What the bridge knows by its configuration, or does not do.
_PORTS_OWN = ("baud", "protocol", "output", "write")


def verify_line(args: argparse.Namespace) -> Mapping[str, Any]:
    """Verify through the broker, and return the document.

    Raises:
        UsageError: There is no such line, or a flag that goes with a port.
        StoppedError: It was interrupted.
        BridgeError: No broker, no bridge, or the bridge says no.
    """
    if given := [flag for flag in _PORTS_OWN if getattr(args, flag) is not None]:
        raise UsageError(f"--{given[0]} goes with a PORT or a STATION: the bridge reads alone")
    config = load_config(find_config(args.config), os.environ)
    line = line_named(config, args.line)
    modules = modules_of(line, args.stations or STATIONS)
    total_s = Verification(line, modules, args.samples).total_s / SHARE
    arguments: dict[str, Any] = {"line": line.id, "samples": args.samples}
    if args.stations:
        arguments["stations"] = format_stations(args.stations)
    document: Mapping[str, Any] = {}
    with asked(config.mqtt, "verify", arguments) as answers, progress(total_s) as tell:
        try:
            for document in answers:
                done = document.get("progress")
                if isinstance(done, int | float):
                    tell((1 - done) * total_s, str(document.get("at", "")))
        except KeyboardInterrupt:
            raise StoppedError("interrupted: the modules are not verified") from None
    if "stations" not in document:
        raise BridgeError("the bridge answered what cannot be read")
    return document
