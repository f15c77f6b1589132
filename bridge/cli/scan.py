"""`wisco2mqtt scan`: finds the modules on a port, and writes a configuration of them."""

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

from bridge.cli.frame.arguments import addresses, duration
from bridge.cli.frame.confirm import confirmed
from bridge.cli.frame.interrupt import StoppedError
from bridge.cli.frame.terminal import Tell, progress
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.busy import open_or_offer
from bridge.cli.through_broker.scan_broker import scan_at_broker
from bridge.cli.views.scan_report import Spent, report
from bridge.commission.findings import Finding, Findings, Found
from bridge.commission.proposal import configuration
from bridge.commission.scan import Scan, ScanStep
from bridge.commission.survey import (
    BAUDS,
    PROTOCOLS,
    QUICK_PROTOCOLS,
    STATIONS,
    Effort,
    ScanPlan,
    effort_at,
    format_stations,
    survey_of,
)
from bridge.errors import BridgeError
from bridge.model import LineProtocol
from bridge.transport.port import Port

NAME = "scan"
EXAMPLES = (
    "scan /dev/ttyUSB0 --expect 2",
    "scan /dev/ttyUSB0 --thorough --baud 9600 --stations 1-2 --json",
    "scan /dev/ttyUSB0 --baud 9600 --expect 2 --write panel.yaml",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where to look, how thoroughly, and what to do with the result."""
    parser.usage = "%(prog)s {PORT | --line LINE} [options]"
    parser.description = (
        "Asks every station at every baud rate in every protocol, the likeliest first, and lists "
        "what answered, with the DIP switches that go with it. It only reads: no output is "
        "switched. Two modules with one address are named where their answers differ. A quick "
        "scan asks each station once; it leaves out Modbus ASCII, as what answers that answers "
        "Wisco too. A thorough one leaves out nothing, waits longer and asks four times, for lines "
        "that lose replies."
    )
    parser.epilog = (
        "Exit status: 0 when modules were found, as many as --expect says, and no clash; else 1."
    )
    add = parser.add_argument
    add("port", metavar="PORT", nargs="?", help="a device, tcp://host:port or rfc2217://host:port")
    add(
        "--line",
        metavar="LINE",
        help="a line of the configuration, in place of PORT: the running bridge scans it between "
        "its polls, at its own baud rate and protocol, and tells through the broker",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--quick", action="store_true", help="the default")
    how.add_argument("--thorough", action="store_true", help="try everything, and ask four times")
    add("--baud", type=_bauds, metavar="BAUD,...", help="only these baud rates")
    add("--protocol", type=_protocols, metavar="NAME,...", help=f"of {', '.join(PROTOCOLS)}")
    add("--stations", type=addresses, metavar="1-8,12", help="only these addresses")
    add("--expect", type=_count, metavar="N", help="stop as soon as so many are found")
    add(
        "--margin",
        type=duration("200ms"),
        metavar="TIME",
        help="how much longer than the bytes take to wait for a reply, such as 200ms for a slow "
        "gateway (default: 30ms, thorough 60ms; over a network 150ms, 250ms)",
    )
    add("--write", type=Path, metavar="FILE", help="write a configuration of what answered")
    add("--force", action="store_true", help="let --write replace a file that is there")
    add("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Scan; return 0 when modules were found and no clash."""
    if (args.port is None) is (args.line is None):
        raise UsageError("give a PORT, or --line with a line of the configuration")
    if args.line is not None:
        return 0 if _is_fine(scan_at_broker(args), None) else 1
    return _scan_port(args)


def _scan_port(args: argparse.Namespace) -> int:
    if args.write is not None:
        check_writable(args.write, force=args.force)
    survey = _survey(args)
    with progress(survey.total_s) as tell:
        scan = Scan(survey, partial(_open, args), _Teller(tell).hear)
        end = _scan(scan, args.expect)
    if scan.findings.found or end is None:
        spent = Spent(scan.took_s, scan.least_s)
        report(args.port, scan.findings, spent, as_json=args.json)
    if isinstance(end, BridgeError):
        raise end
    if end is not None:
        raise StoppedError(f"interrupted: the scan is not at its end{_offer(args, scan)}")
    if args.write is not None and scan.findings.found:
        write_proposal(
            args.write,
            configuration(args.port, scan.findings.found, scan.findings.clashes),
            force=args.force,
        )
    return 0 if _is_fine(scan.findings, args.expect) else 1


def _offer(args: argparse.Namespace, scan: Scan) -> str:
    """Offer to write what was found before an interruption; tell what became of the file."""
    if args.write is None:
        return ""
    found = scan.findings.found
    question = f"write what was found so far ({len(found)} of them) to {args.write}?"
    if found and sys.stdin.isatty() and confirmed(question, yes=False):
        write_proposal(
            args.write, configuration(args.port, found, scan.findings.clashes), force=args.force
        )
        return f"; {args.write} has what was found so far"
    return f"; {args.write} is not written"


def _open(args: argparse.Namespace, baud: int) -> Port:
    """Open the port; name the command through the bridge if the bridge has it."""
    more = " --thorough" if args.thorough else ""
    more += f" --stations {format_stations(args.stations)}" if args.stations else ""
    return open_or_offer(args.port, baud, args.config, lambda line: f"scan --line {line}{more}")


def _scan(scan: Scan, expect: int | None) -> BaseException | None:
    """Scan to the end; return the error that ended it, so that the findings are still shown."""
    try:
        scan.run(expect)
    except (BridgeError, KeyboardInterrupt) as end:
        return end
    return None


class _Teller:
    """Shows the progress and the findings at a terminal."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._found = 0

    def hear(self, event: ScanStep | Finding) -> None:
        """Handle one event of the scan."""
        if isinstance(event, Found):
            self._found += 1
        if isinstance(event, ScanStep):
            where = f"{event.sweep.baud} baud, {event.sweep.protocol}, station {event.address}"
            again = f", round {event.round} of {event.rounds}" if event.rounds > 1 else ""
            self._tell(event.left_s, f"{where}{again}; {self._found} found")


def _survey(args: argparse.Namespace) -> ScanPlan:
    """Return the requests of the scan. A raw gateway keeps its baud rate."""
    bauds = args.baud or BAUDS
    if args.port.startswith("tcp://"):
        bauds = args.baud or BAUDS[:1]
        if len(bauds) > 1:
            raise UsageError(f"{args.port} has one baud rate, its gateway's own: give that one")
        print(
            f"{args.port}: the gateway sets the baud rate, and only that one is scanned; time-outs "
            f"are for {bauds[0]} baud (--baud names another)",
            file=sys.stderr,
        )
    protocols = args.protocol or (PROTOCOLS if args.thorough else QUICK_PROTOCOLS)
    survey = survey_of(bauds, protocols, args.stations or STATIONS, _effort(args))
    if not survey.sweeps:
        raise UsageError("there is nothing to ask: in Modbus, 0 is no station but all of them")
    return survey


def _effort(args: argparse.Namespace) -> Effort:
    effort = effort_at(args.port, thorough=args.thorough)
    return effort if args.margin is None else Effort(effort.tries, args.margin)


def _is_fine(findings: Findings, expect: int | None) -> bool:
    enough = len(findings.found) == expect if expect is not None else bool(findings.found)
    return enough and not findings.clashes


# --- the file ---


def check_writable(path: Path, *, force: bool) -> None:
    """Check before the scan, so that minutes are not lost."""
    if path.exists() and not force:
        raise BridgeError(f"{path} is there already: --force replaces it")
    if not path.absolute().parent.is_dir():
        raise BridgeError(f"{path} cannot be written: there is no such folder")


def write_proposal(path: Path, text: str, *, force: bool) -> None:
    """Write a configuration of what answered."""
    try:
        with path.open("w" if force else "x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise BridgeError(f"{path} cannot be written: {error.strerror}") from error
    print(f"{path} is written: edit it, then `wisco2mqtt -c {path} check`", file=sys.stderr)


# --- what flags mean ---


def _bauds(text: str) -> tuple[int, ...]:
    known = {str(baud): baud for baud in BAUDS}
    return tuple(known[_one_of(part, known)] for part in text.split(","))


def _protocols(text: str) -> tuple[LineProtocol, ...]:
    known = {protocol.value: protocol for protocol in PROTOCOLS}
    return tuple(known[_one_of(part, known)] for part in text.split(","))


def _one_of(part: str, known: dict[str, Any]) -> str:
    if part not in known:
        raise argparse.ArgumentTypeError(f"{part!r} is none of {', '.join(known)}")
    return part


def _count(text: str) -> int:
    if not text.isascii() or not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no count of modules")
    return int(text)
