"""`scan --line`: lets the running bridge scan a line between its polls."""

import argparse
import os
import time
from collections.abc import Mapping
from typing import Any

from bridge.cli.frame.interrupt import StoppedError
from bridge.cli.frame.terminal import Tell, progress
from bridge.cli.frame.usage import UsageError
from bridge.cli.through_broker.ask_bridge import asked, line_named
from bridge.cli.views.scan_report import Spent, report
from bridge.commission.findings import Findings
from bridge.commission.line_scan import LineScan
from bridge.commission.scan_document import read_findings
from bridge.commission.survey import STATIONS, format_stations
from bridge.config.load import find_config, load_config
from bridge.errors import BridgeError

# Options that a scan by the bridge does not use, or cannot have.
_PORTS_OWN = ("baud", "protocol", "expect", "margin", "write")


def scan_at_broker(args: argparse.Namespace) -> Findings:
    """Scan through the broker, print what was found, and give it.

    Raises:
        UsageError: There is no such line, or a flag that goes with a port.
        StoppedError: It was interrupted; what was found so far is printed.
        BridgeError: No broker, no bridge, or the bridge says no.
    """
    if given := [flag for flag in _PORTS_OWN if getattr(args, flag) is not None]:
        raise UsageError(
            f"--{given[0]} goes with a PORT: the bridge scans a line as it is configured, whole"
        )
    config = load_config(find_config(args.config), os.environ)
    line = line_named(config, args.line)
    scan = LineScan(line, args.stations or STATIONS, thorough=args.thorough)
    arguments: dict[str, Any] = {"line": line.id, "thorough": args.thorough}
    if args.stations:
        arguments["stations"] = format_stations(args.stations)
    began = time.monotonic()
    document: Mapping[str, Any] = {}
    stopped = False
    with asked(config.mqtt, "scan", arguments) as answers, progress(scan.total_s) as tell:
        try:
            for document in answers:
                _tell(document, scan.total_s, tell)
        except KeyboardInterrupt:
            stopped = True
    findings = _findings(document) if document or not stopped else Findings()
    report(line.port, findings, Spent(time.monotonic() - began), as_json=args.json)
    if stopped:
        raise StoppedError("interrupted: the scan is not at its end")
    return findings


def _tell(document: Mapping[str, Any], total_s: float, tell: Tell) -> None:
    done, found = document.get("progress"), document.get("found")
    if isinstance(done, int | float) and isinstance(found, list):
        tell((1 - done) * total_s, f"{len(found)} found")


def _findings(document: Mapping[str, Any]) -> Findings:
    try:
        return read_findings(document)
    except ValueError as error:
        raise BridgeError(f"the bridge answered what cannot be read: {error}") from error
