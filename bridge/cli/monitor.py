"""`wisco2mqtt monitor`: what passes on a line, decoded as it passes. Sends nothing."""

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from bridge.cli.interrupt import sigterm_interrupts
from bridge.cli.monitor_record import Recorder, recording
from bridge.cli.monitor_view import json_of, line_of, table_of, wants_colour
from bridge.commission.line_statistics import LineStatistics
from bridge.config.durations import parse_duration
from bridge.model import BAUD_RATES
from bridge.protocol.passive.listener import Heard, Listener
from bridge.transport.opener import open_port
from bridge.transport.port import Port

NAME = "monitor"
HELP = "show what passes on a line, decoded, and record it"
EXAMPLES = (
    "monitor /dev/ttyUSB1",
    "monitor /dev/ttyUSB1 --baud 9600 --record line.txt --record line.pcapng --for 10s",
    "monitor /dev/ttyUSB1 --json",
)

_LOOK_S = 0.05
_ENOUGH_NOISE = 5  # pieces, and not one frame among them


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the port, and what is shown and kept."""
    parser.description = (
        "Listens on a port and shows every frame that passes, requests and replies, in whichever "
        "of the three protocols: seconds, milliseconds since the frame before, > to the modules "
        "or < from them, station, bytes, meaning. It sends nothing. Use a second adapter on the "
        "same two wires: the port of a running bridge is the bridge's alone. SIGINT ends it and "
        "shows the counts of each station on stderr."
    )
    parser.epilog = "For Wireshark: tshark -r line.pcapng -d rtacser.data,mbrtu"
    add = parser.add_argument
    add("port", metavar="PORT", help="a device, tcp://host:port or rfc2217://host:port")
    add("--baud", type=int, choices=BAUD_RATES, default=9600, help="default: 9600")
    add(
        "--record",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="write a transcript, or for Wireshark where FILE ends in .pcapng; repeat",
    )
    add("--for", dest="span_s", type=_seconds, metavar="TIME", help="end after so long, as 30s")
    add("--quiet", action="store_true", help="show the counts at the end alone")
    add("--json", action="store_true", help="a JSON object a line")


def run(args: argparse.Namespace) -> int:
    """Listens until SIGINT, SIGTERM or --for."""
    statistics = LineStatistics()
    with ExitStack() as stack:
        stack.enter_context(sigterm_interrupts())
        port = open_port(args.port, args.baud)
        stack.callback(port.close)
        record = partial(recording, port=args.port, baud=args.baud, epoch_s=_epoch_s())
        recorders = [stack.enter_context(record(path)) for path in args.record]
        stack.callback(_report, statistics)  # however it ends
        began = time.monotonic()
        until = None if args.span_s is None else began + args.span_s
        _watch(_listen(port, until), args, began, recorders, statistics)
    return 0


def _watch(
    conversation: Iterator[Heard],
    args: argparse.Namespace,
    began: float,
    recorders: Sequence[Recorder],
    statistics: LineStatistics,
) -> None:
    colour = wants_colour(sys.stdout, os.environ)
    try:
        for heard in conversation:
            statistics.count(heard)
            for recorder in recorders:
                recorder.take(heard)
            if not args.quiet:
                text = json_of(heard, began) if args.json else line_of(heard, began, colour=colour)
                print(text, flush=True)
    except KeyboardInterrupt:
        return


def _listen(port: Port, until: float | None) -> Iterator[Heard]:
    listener = Listener()
    while until is None or time.monotonic() < until:
        data = port.read(1, time.monotonic() + _LOOK_S)
        data += port.discard() if data else b""
        now = time.monotonic()
        yield from listener.hear(data, now) if data else listener.pass_time(now)


def _report(statistics: LineStatistics) -> None:
    rows = table_of(statistics)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True))
        print("  ".join(cells), file=sys.stderr)
    if advice := _advice(statistics):
        print(advice, file=sys.stderr)


def _advice(statistics: LineStatistics) -> str | None:
    if statistics.frames:
        return None
    noise = sum(counts.damaged for counts in statistics.by_station.values())
    if noise >= _ENOUGH_NOISE:
        return "bytes, and not one frame: is --baud right, and are A and B swapped?"
    return "nothing passed: is a master at work on this line, and the adapter on its two wires?"


def _epoch_s() -> float:
    """What to add to monotonic instants so that they count from 1970."""
    return time.time() - time.monotonic()


def _seconds(text: str) -> float:
    try:
        return float(parse_duration(text))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no time: write a number and its unit, such as 30s"
        ) from None
