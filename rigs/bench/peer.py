"""Puts another program on the benchmark's line, by hand, and prints the same figures of it.

    python -m bench.peer C:modbus-rtu --topic 'peer/{station}/di/{channel}' --on 1 --off 0

prints the ports and the broker's port, waits for the program to be started on them, and measures
it. What stands behind `--` is started (and ended) here, with `{port}` and `{broker}` filled in.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.mosquitto import Mosquitto

from bench.cases import Case, all_cases
from bench.figures import Spread, Topic, cycles, delays_of_inputs
from bench.listener import Listener
from bench.wire import Wire

_START_S = 300.0
_SETTLE_S = 5.0
_STOP_S = 5.0


def main(arguments: list[str]) -> int:
    """Prints what was measured; 1: the program never asked for anything."""
    options, command = _options(arguments)
    with tempfile.TemporaryDirectory(prefix="bench-peer-") as directory:
        broker = Mosquitto(Path(directory), options=("log_type none", "max_queued_messages 0"))
        broker.start()
        try:
            with (
                Wire([options.case.spec] * options.case.lines) as wire,
                Listener(broker.port) as listener,
            ):
                _introduce(options.case, wire, broker.port)
                with _started(command, wire, broker.port) as process:
                    return _measure(options, wire, listener, process)
        finally:
            broker.stop()


def _options(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    cases = {f"{case.letter}:{case.protocol}": case for case in all_cases() if case.paced}
    own, command = _split(arguments)
    parser = argparse.ArgumentParser(prog="bench.peer")
    parser.add_argument("case", type=cases.__getitem__, help=f"one of {', '.join(cases)}")
    parser.add_argument(
        "--topic", help="of an input, with {line}, {station} and {channel} (from 1)"
    )
    parser.add_argument("--on", default="ON", help="its payload")
    parser.add_argument("--off", default="OFF", help="its payload")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each measurement")
    return parser.parse_args(own), command


def _split(arguments: list[str]) -> tuple[list[str], list[str]]:
    if "--" not in arguments:
        return arguments, []
    at = arguments.index("--")
    return arguments[:at], arguments[at + 1 :]


def _introduce(case: Case, wire: Wire, broker: int) -> None:
    print(f"ports: {' '.join(wire.ports)}, {case.baud} baud, 8N1, {case.protocol}")
    print(f"stations: {case.addresses[0]}-{case.addresses[-1]}, each a DIO100; broker: {broker}")
    print(
        f"limit of the plain cycle: {case.limit.cycle_s(len(case.live)) * 1000:.1f} ms", flush=True
    )


@contextmanager
def _started(
    command: list[str], wire: Wire, broker: int
) -> Iterator[subprocess.Popen[bytes] | None]:
    if not command:
        yield None
        return
    filled = [part.format(port=wire.ports[0], broker=broker) for part in command]
    with subprocess.Popen(filled, stdout=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.terminate()
            process.wait(_STOP_S)


def _measure(
    options: argparse.Namespace,
    wire: Wire,
    listener: Listener,
    process: subprocess.Popen[bytes] | None,
) -> int:
    give_up = time.monotonic() + _START_S
    while not wire.take().reads:
        ended = process is not None and process.poll() is not None
        if ended or time.monotonic() > give_up:
            print("nothing was asked on the line", file=sys.stderr)
            return 1
        time.sleep(0.1)
    time.sleep(_SETTLE_S)
    wire.begin()
    time.sleep(options.seconds)
    seen = wire.take()
    for line in range(options.case.lines):
        print(f"line {line}: from inputs to inputs, ms: {_words(cycles(seen.reads, line))}")
    print(f"cut short: {seen.early}, overlapping: {seen.overlapping}, silent: {seen.unanswered}")
    if options.topic:
        print(f"input to MQTT, ms: {_words(_inputs(options, wire, listener))}")
    return 0


def _inputs(options: argparse.Namespace, wire: Wire, listener: Listener) -> Spread | None:
    wire.begin()
    listener.begin()
    wire.toggle(options.case.toggle_each_s)
    time.sleep(options.seconds)
    wire.toggle(0)
    time.sleep(_SETTLE_S)
    topic = Topic(options.topic, options.on.encode(), options.off.encode())
    return delays_of_inputs(wire.take(), listener.heard(), topic)


def _words(spread: Spread | None) -> str:
    return f"{spread.p50:.1f} / {spread.p99:.1f} (of {spread.count})" if spread else "-"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
