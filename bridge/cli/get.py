"""`wisco2mqtt get`: reads one module on its port, without a broker."""

import argparse
import json
import re
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from bridge.cli.frame.terminal import print_table
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.one_station import Visit, add_flags, find_place, visit
from bridge.clock import boot_s
from bridge.errors import ExchangeError
from bridge.line.rules.tracker import Outcome
from bridge.line.station import Station
from bridge.model import bit

NAME = "get"
EXAMPLES = (
    "get garage",
    "get garage do/3",
    "get --port /dev/ttyUSB0 --station 1 di --watch",
)

_TARGET = re.compile(r"(di|do)(/[1-9][0-9]?)?|do/[1-9][0-9]?/(mode|hold)")
_MISSES = 3  # in a row: then `--watch` reports it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the module and the target."""
    parser.usage = "%(prog)s [STATION | --port PORT --station 0-31] [TARGET] [options]"
    parser.description = (
        "Reads inputs, outputs, modes and hold times of one module: of a station of the "
        "configuration, or of --port and --station. One channel prints its value alone."
    )
    parser.add_argument(
        "words",
        nargs="*",
        metavar="[STATION] [TARGET]",
        help="STATION: its id, without --port. TARGET: di, do, di/3, do/3, do/3/mode, do/3/hold",
    )
    add_flags(parser)
    parser.add_argument("--watch", action="store_true", help="go on, and print what changes")
    parser.add_argument("--json", action="store_true", help="print JSON, with --watch a line each")


def run(args: argparse.Namespace) -> int:
    """Return 0 when the module was read; faults are raised as errors."""
    place, words = find_place(args, args.words)
    target = _target(words)
    with visit(place, "watch STATION") as met:
        values = values_of(met.station)
        chosen = _chosen(values, target, met)
        if args.watch:
            _watch(met, chosen, as_json=args.json)
        elif args.json:
            print(json.dumps(_document(met, chosen), ensure_ascii=False))
        else:
            _print(met, chosen, target)
    return 0


def values_of(station: Station) -> dict[str, str]:
    """Return the values that were read, by topic below the station, after `invert`."""
    config, settings = station.config, station.settings
    values = {f"di/{c.channel}": _word(station.inputs.value, c.channel) for c in config.inputs}
    for output in config.outputs:
        name = f"do/{output.channel}"
        values[name] = _word(station.outputs.value, output.channel)
        if settings is not None:
            values[f"{name}/mode"] = "pulse" if settings.pulse & bit(output.channel) else "latch"
            values[f"{name}/hold"] = f"{settings.hold_ds[output.channel - 1] / 10:.1f}"
    return values


def _word(bits: int | None, channel: int) -> str:
    return "ON" if (bits or 0) & bit(channel) else "OFF"


def _target(words: list[str]) -> str | None:
    if len(words) > 1:
        raise UsageError(f"{words[1]} is one word too many: one TARGET is read, or all")
    if words and not _TARGET.fullmatch(words[0]):
        raise UsageError(
            f"{words[0]} is no target: give di, do, di/3, do/3, do/3/mode or do/3/hold"
        )
    return words[0] if words else None


def _chosen(values: Mapping[str, str], target: str | None, met: Visit) -> dict[str, str]:
    if target is not None and target in values:
        return {target: values[target]}
    chosen = {k: v for k, v in values.items() if target is None or k.startswith(f"{target}/")}
    if not chosen:
        model = met.station.config.model.name
        unread = target is not None and target.endswith(("mode", "hold"))
        why = ", or it takes no Modbus frames" if unread else ""
        raise UsageError(f"{met.place.name} is a {model} and has no {target}{why}")
    return chosen


# --- once ---


def _print(met: Visit, chosen: Mapping[str, str], target: str | None) -> None:
    if target is not None and target in chosen:
        print(chosen[target])
        return
    if sys.stdout.isatty():
        _print_for_people(met, chosen)
    else:
        for name, value in chosen.items():
            print(name, value)
    where = f"station {met.place.address}, {met.place.line.baud} baud, {met.place.line.protocol}"
    model = met.station.config.model.name
    print(f"{met.place.name}: {model}, {where}; read in {met.ms} ms", file=sys.stderr)


def _print_for_people(met: Visit, chosen: Mapping[str, str]) -> None:
    config = met.station.config
    names = {f"di/{channel.channel}": channel.name for channel in config.inputs}
    names |= {f"do/{channel.channel}": channel.name for channel in config.outputs}
    rows = [
        (name, value, chosen.get(f"{name}/mode", ""), _hold(chosen, name), names[name] or "")
        for name, value in chosen.items()
        if name in names
    ]
    print_table(("channel", "state", "mode", "hold", "name"), rows)


def _hold(chosen: Mapping[str, str], name: str) -> str:
    hold = chosen.get(f"{name}/hold")
    return f"{hold} s" if hold else ""


def _document(met: Visit, chosen: Mapping[str, str]) -> dict[str, Any]:
    return {
        "station": met.place.name,
        "address": met.place.address,
        "model": met.station.config.model.name,
        "values": dict(chosen),
        "ms": met.ms,
    }


# --- until Ctrl-C ---


def _watch(met: Visit, chosen: Mapping[str, str], *, as_json: bool) -> None:
    """Print the present values, marked with `=`, and then the changes."""
    shown = dict(chosen)
    for name, value in shown.items():
        _print_change(name, value, "= ", as_json=as_json)
    misses = 0
    while True:
        try:
            _read(met)
        except ExchangeError as error:
            misses += 1
            if misses == _MISSES:
                print(f"{met.place.name} does not answer: {error}", file=sys.stderr)
            continue
        if misses >= _MISSES:
            print(f"{met.place.name} answers again", file=sys.stderr)
        misses = 0
        values = values_of(met.station)
        for name in [name for name, value in shown.items() if values[name] != value]:
            shown[name] = values[name]
            _print_change(name, values[name], "", as_json=as_json)


def _read(met: Visit) -> None:
    """Read all channels once; read an unprotected change a second time."""
    station, reader = met.station, met.station.reader
    banks = [(reader.read_outputs, station.outputs)]
    if station.config.model.inputs:
        banks.insert(0, (reader.read_inputs, station.inputs))
    for request, bank in banks:
        for _ in range(2):
            raw = met.bus.exchange(request, protected=reader.protected)
            if bank.observe(raw, boot_s()) is not Outcome.READ_AGAIN:
                break


def _print_change(name: str, value: str, mark: str, *, as_json: bool) -> None:
    now = datetime.now(UTC).astimezone()
    if as_json:
        document = {"time": now.isoformat(timespec="milliseconds"), "target": name, "value": value}
        print(json.dumps(document), flush=True)
    else:
        print(f"{now:%H:%M:%S}.{now.microsecond // 1000:03} {mark}{name} {value}", flush=True)
