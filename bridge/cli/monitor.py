"""`wisco2mqtt monitor`: shows the frames on a line, decoded. It sends nothing."""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from bridge.cli.frame.arguments import duration
from bridge.cli.frame.interrupt import interrupts_kept
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.busy import open_or_offer
from bridge.cli.through_broker.monitor_line import MonitorSource, traced_line
from bridge.cli.views.monitor_record import Recorder, recording
from bridge.cli.views.monitor_view import json_of, line_of, table_of, wants_colour
from bridge.clock import boot_s
from bridge.commission.line_statistics import HeardStatistics
from bridge.model import BAUD_RATES, USUAL_BAUD
from bridge.protocol.passive.listener import Heard, Listener
from bridge.transport.port import Port

NAME = "monitor"
EXAMPLES = (
    "monitor /dev/ttyUSB1",
    "monitor /dev/ttyUSB1 --baud 9600 --record line.txt --record line.pcapng --for 10s",
    "monitor /dev/ttyUSB1 --json",
)

_LOOK_S = 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the port, the output and the records."""
    parser.usage = "%(prog)s {PORT | --line LINE} [options]"
    parser.description = (
        "Listens on a port and shows every frame that passes, requests and replies, in whichever "
        "of the three protocols: seconds, milliseconds since the frame before, > to the modules "
        "or < from them, station, bytes, meaning. It sends nothing. Use a second adapter on the "
        "same two wires: the port of a running bridge is the bridge's alone. Or give --line, and "
        "the bridge itself tells, through the broker, what passes on its line. SIGINT ends it and "
        "shows the counts of each station on stderr."
    )
    parser.epilog = "For Wireshark: tshark -r line.pcapng -d rtacser.data,mbrtu"
    add = parser.add_argument
    add("port", metavar="PORT", nargs="?", help="a device, tcp://host:port or rfc2217://host:port")
    add("--line", metavar="LINE", help="a line of the configuration, in place of PORT")
    add("--baud", type=int, choices=BAUD_RATES, help=f"default: {USUAL_BAUD}; goes with PORT")
    add(
        "--record",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="write a transcript, or for Wireshark where FILE ends in .pcapng; repeat",
    )
    add(
        "--for",
        dest="span_s",
        type=duration("30s"),
        metavar="TIME",
        help="end after so long, as 30s",
    )
    add("--quiet", action="store_true", help="show the counts at the end alone")
    add("--json", action="store_true", help="a JSON object a line")


def run(args: argparse.Namespace) -> int:
    """Listen until SIGINT, SIGTERM or --for."""
    if (args.port is None) is (args.line is None):
        raise UsageError("give a PORT, or --line with a line of the configuration")
    if args.line is not None and args.baud is not None:
        raise UsageError("--baud goes with a PORT: a line has its own")
    statistics = HeardStatistics()
    with ExitStack() as stack:
        source = _open(args, stack)
        record = partial(recording, port=source.port, baud=source.baud, epoch_s=source.epoch_s)
        recorders = [stack.enter_context(record(path)) for path in args.record]
        stack.callback(_report, statistics, source)  # whatever ends it
        with interrupts_kept() as stopped:
            _watch(source.heard(stopped), args, recorders, statistics)
    return 0


def _open(args: argparse.Namespace, stack: ExitStack) -> MonitorSource:
    """Open the source, which is closed with `stack`."""
    if args.line is not None:
        return stack.enter_context(traced_line(args.line, args.config, args.span_s))
    baud = args.baud or USUAL_BAUD
    port = open_or_offer(args.port, baud, args.config, "monitor --line {}".format)
    stack.callback(port.close)
    until = None if args.span_s is None else boot_s() + args.span_s
    heard = partial(_listen, port, until)
    return MonitorSource(args.port, baud, _epoch_s(), heard, _advice)


def _watch(
    conversation: Iterator[Heard],
    args: argparse.Namespace,
    recorders: Sequence[Recorder],
    statistics: HeardStatistics,
) -> None:
    colour = wants_colour(sys.stdout, os.environ)
    began: float | None = None
    for heard in conversation:
        began = heard.at if began is None else began
        statistics.count(heard)
        for recorder in recorders:
            recorder.record(heard)
        if not args.quiet:
            text = json_of(heard, began) if args.json else line_of(heard, began, colour=colour)
            print(text, flush=True)


def _listen(port: Port, until: float | None, stopped: Callable[[], bool]) -> Iterator[Heard]:
    listener = Listener()
    while not stopped() and (until is None or boot_s() < until):
        data = port.read(1, boot_s() + _LOOK_S)
        data += port.discard() if data else b""
        now = boot_s()
        yield from listener.hear(data, now) if data else listener.pass_time(now)
    yield from listener.end()


def _report(statistics: HeardStatistics, source: MonitorSource) -> None:
    rows = table_of(statistics)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True))
        print("  ".join(cells), file=sys.stderr)
    if advice := source.advice(statistics):
        print(advice, file=sys.stderr)


def _advice(statistics: HeardStatistics) -> str | None:
    if statistics.frames:
        return None
    if statistics.by_address:
        return "bytes, and not one frame: is --baud right, and are A and B swapped?"
    return "nothing passed: is a master at work on this line, and the adapter on its two wires?"


def _epoch_s() -> float:
    """Return the offset from monotonic instants to seconds since 1970."""
    return time.time() - boot_s()
