"""`wisco2mqtt simulate`: simulated modules on pseudo-terminals or TCP ports."""

import argparse
import os
import re
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from bridge.cli.desk.panel import Panel, objection_to_panel
from bridge.cli.desk.simulate_console import Console
from bridge.cli.frame.arguments import duration
from bridge.cli.frame.signals import StopSignals
from bridge.cli.frame.usage import UsageError
from bridge.config.endpoints import MAX_PORT
from bridge.config.load import load_config
from bridge.errors import BridgeError
from bridge.model import (
    BAUD_RATES,
    LAST_ADDRESS,
    MODULE_TYPES,
    USUAL_BAUD,
    LineProtocol,
    ModuleType,
)
from bridge.simulator.build import build_line, endpoint_for
from bridge.simulator.control import place_of
from bridge.simulator.dialect import Dialect, Tongue
from bridge.simulator.endpoint import Endpoint
from bridge.simulator.faults import FaultKind
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import Listener, SimulatedModule, Switching
from bridge.simulator.player import Player
from bridge.simulator.pty import PtyEndpoint
from bridge.simulator.recording import Recording
from bridge.simulator.scenario import load_scenario
from bridge.simulator.tcp import TcpEndpoint
from bridge.transcript import load_transcript

NAME = "simulate"
EXAMPLES = (
    "simulate --module DIO100@1 --module DO100@2 --pty /tmp/panel",
    "simulate --module DIO100@1 --protocol modbus-rtu --tcp 4196 --fault silent=0.05",
    "simulate -c config.yaml --directory /tmp/lines",
)

Desk = Console | Panel  # shows messages, and takes orders of the user

LINE_OF_FLAGS = "main"
# Flags that describe a line; -c FILE does the same.
LINE_FLAGS = ("module", "replay", "protocol", "baud", "turnaround", "tcp", "pty", "tap")

_MODULE = re.compile(r"(?P<model>\w+)@(?P<station>0|[1-9][0-9]?)")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    parser.description = (
        "Simulates modules until SIGINT or SIGTERM: those of --module on one line, or all of -c "
        "FILE. While it runs, lines on stdin drive it: `1 di/3 ON` (OFF, TOGGLE), `1 away`, "
        "`1 back`, `show`; with several lines `LINE/1 ...`. Outputs that change are printed."
    )
    add = parser.add_argument
    add("--module", action="append", type=_module, metavar="MODEL@STATION", help="DIO100@1; repeat")
    add("--protocol", choices=[each.value for each in LineProtocol], help="default: wisco")
    add("--baud", type=int, choices=BAUD_RATES, help="default: 9600")
    add(
        "--turnaround",
        type=duration("2ms"),
        metavar="TIME",
        help="from request to reply; default: 2ms",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--tcp", type=_tcp_port, metavar="PORT", help="listen on 127.0.0.1:PORT")
    where.add_argument("--pty", type=Path, metavar="PATH", help="a link to make to the pty")
    add("--tap", type=Path, metavar="PATH", help="a second link, on which monitor can listen")
    add("--replay", type=Path, metavar="FILE", help="answer as the transcript of a monitor says")
    add("--directory", type=Path, metavar="DIR", help="with -c: where links LINE to ptys are made")
    add("--unpaced", action="store_true", help="bytes take no time on the wire")
    kinds = ", ".join(FaultKind)
    add(
        "--fault",
        action="append",
        default=[],
        type=_fault,
        metavar="KIND=PROBABILITY",
        help=f"repeat; KIND is one of {kinds}",
    )
    add(
        "--dialect",
        type=_dialects,
        metavar="NAME,...",
        help=f"what the modules do otherwise than assumed: {', '.join(Dialect)}",
    )
    add("--panel", action="store_true", help="show the modules with their LEDs; keys drive them")
    add("--scenario", type=Path, metavar="FILE", help="YAML: what happens, and when")


def run(args: argparse.Namespace) -> int:
    """Simulate until a signal comes."""
    signals = StopSignals()
    signals.install()
    with ExitStack() as stack:
        console = _desk(panel=args.panel)
        stack.enter_context(console)
        lines = {line.name: line for line in _lines(args, console)}
        for kind, probability in args.fault:
            for line in lines.values():
                line.faults.set(kind, probability=probability)
        scenario = load_scenario(args.scenario, lines) if args.scenario else None
        for line in lines.values():
            _start(line, stack)
            print(_ready(line), flush=True)
        if scenario:
            stack.enter_context(Player(scenario))
        console.attend(lines, signals.poll)
    return 0


def _desk(*, panel: bool) -> Desk:
    objection = objection_to_panel() if panel else None
    if objection:
        print(f"{objection}; lines on stdin drive the modules all the same", file=sys.stderr)
    return Panel() if panel and not objection else Console()


def _start(line: SimulatedLine, stack: ExitStack) -> None:
    try:
        stack.enter_context(line)
    except OSError as error:
        raise BridgeError(f"line {line.name} cannot appear at {line.port}: {error}") from error


def _ready(line: SimulatedLine) -> str:
    counts = Counter(module.model.name for module in line.modules.values())
    modules = ", ".join(f"{count} {model}" for model, count in counts.items())
    who = modules or "answers of a transcript"
    return f"line {line.name}: {line.port} {line.protocol} {line.baud}: {who}"


# --- which lines ---


def _lines(args: argparse.Namespace, console: Desk) -> Iterator[SimulatedLine]:
    if args.config is None:
        yield _line_of_flags(args, partial(_report, console, ""))
        return
    if given := [f"--{flag}" for flag in LINE_FLAGS if getattr(args, flag) is not None]:
        raise UsageError(f"{given[0]} does not go with -c: the file says what the lines are")
    configs = load_config(args.config, os.environ, secrets=False).lines
    for config in configs:
        yield build_line(
            config,
            endpoint=endpoint_for(config, args.directory),
            paced=not args.unpaced,
            listener=partial(_report, console, config.id if len(configs) > 1 else ""),
            tongue=args.dialect,
        )


def _line_of_flags(args: argparse.Namespace, listener: Listener) -> SimulatedLine:
    _check_flags(args)
    transcript = load_transcript(args.replay) if args.replay else None
    protocol = args.protocol or (transcript.protocol if transcript else LineProtocol.WISCO)
    if protocol is None:
        raise UsageError(f"{args.replay} does not say its protocol: add --protocol")
    baud = args.baud or (transcript and transcript.baud) or USUAL_BAUD
    return SimulatedLine(
        protocol,
        baud,
        [SimulatedModule(*module, listener=listener) for module in args.module or ()],
        paced=not args.unpaced,
        turnaround_s=0.002 if args.turnaround is None else args.turnaround,
        endpoint=_endpoint(args, baud),
        tap=_tap(args, baud),
        recording=Recording(transcript.entries) if transcript else None,
        tongue=None if transcript else args.dialect,
        name=LINE_OF_FLAGS,
    )


def _check_flags(args: argparse.Namespace) -> None:
    addresses = [address for _, address in args.module or ()]
    if args.replay and args.module:
        raise UsageError("--replay does not go with --module: the transcript answers")
    if not args.replay and not args.module:
        raise UsageError("say what to simulate: --module DIO100@1, -c FILE, or --replay FILE")
    if len(set(addresses)) < len(addresses):
        raise UsageError("two modules have one station; give each its own")
    if args.directory:
        raise UsageError("--directory goes with -c; write --pty PATH")


def _tap(args: argparse.Namespace, baud: int) -> PtyEndpoint | None:
    return PtyEndpoint(args.tap, baud=baud) if args.tap else None


def _endpoint(args: argparse.Namespace, baud: int) -> Endpoint:
    return PtyEndpoint(args.pty, baud=baud) if args.tcp is None else TcpEndpoint(args.tcp)


def _report(console: Desk, line: str, address: int, switching: Switching) -> None:
    """Show a switching; called in the thread of the line."""
    if switching.changed:
        place = place_of(line, address, several=bool(line))
        console.post(f"{place} do/{switching.output} {'ON' if switching.value else 'OFF'}")


# --- what flags mean ---


def _module(text: str) -> tuple[ModuleType, int]:
    match = _MODULE.fullmatch(text)
    if match is None or match["model"] not in MODULE_TYPES or int(match["station"]) > LAST_ADDRESS:
        models = " or ".join(MODULE_TYPES)
        raise argparse.ArgumentTypeError(
            f"{text!r} is no module: write {models}, @ and a station from 0 to {LAST_ADDRESS}"
        )
    return MODULE_TYPES[match["model"]], int(match["station"])


def _tcp_port(text: str) -> int:
    if not text.isdecimal() or int(text) > MAX_PORT:
        raise argparse.ArgumentTypeError(f"{text!r} is no port: write 1 to {MAX_PORT}")
    return int(text)


def _fault(text: str) -> tuple[FaultKind, float]:
    kind, _, probability = text.partition("=")
    try:
        found = FaultKind(kind), float(probability)
    except ValueError:
        found = None
    if found is None or not 0 <= found[1] <= 1:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no fault: write a kind, = and a probability, such as silent=0.05; "
            f"kinds are {', '.join(FaultKind)}"
        )
    return found


def _dialects(text: str) -> Tongue:
    names = text.split(",")
    if unknown := [name for name in names if name not in tuple(Dialect)]:
        raise argparse.ArgumentTypeError(
            f"{unknown[0]!r} is no dialect: there are {', '.join(Dialect)}"
        )
    return Tongue.of([Dialect(name) for name in names])
