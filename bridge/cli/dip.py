"""`wisco2mqtt dip`: draws the switch block for a station, baud rate and protocol, and back."""

import argparse
import json
from collections.abc import Sequence
from typing import Any

from bridge.cli.frame.usage import UsageError
from bridge.commission.dip import DipMeaning, meaning_of, switches_for
from bridge.model import BAUD_RATES, USUAL_BAUD, LineProtocol

NAME = "dip"
EXAMPLES = (
    "dip --station 13 --baud 9600 --protocol wisco",
    "dip 10110 10 1",
    "dip 10110101 --json",
)

_PROTOCOL_NAMES = {
    LineProtocol.WISCO: "Wisco",
    LineProtocol.MODBUS_RTU: "Modbus RTU",
    LineProtocol.MODBUS_ASCII: "Modbus ASCII",
}
_BROADCAST_NOTE = (
    "Station 0 is of use with Wisco frames alone: in Modbus it is the broadcast address, "
    "to which nothing replies."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare both directions: flags to positions, positions to meaning."""
    parser.epilog = "Switch 1 comes first and is the station's least significant bit; 1 is ON."
    parser.add_argument(
        "switches", nargs="*", metavar="SWITCHES", help="eight positions, as 10110101 or 10110 10 1"
    )
    parser.add_argument("--station", type=int, metavar="0-31", help="show the switches for it")
    parser.add_argument("--baud", type=int, choices=BAUD_RATES, help="default: 9600")
    parser.add_argument(
        "--protocol", choices=[protocol.value for protocol in LineProtocol], help="default: wisco"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print the picture and its meaning."""
    try:
        switches = _given(args) if args.switches else _wanted(args)
        meaning = meaning_of(switches)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if args.json:
        print(json.dumps(document(switches, meaning)))
    else:
        print(picture(switches))
        print(describe(meaning))
    return 0


def document(switches: Sequence[bool], meaning: DipMeaning) -> dict[str, Any]:
    """Return the same for programs."""
    return {
        "switches": "".join(f"{switch:d}" for switch in switches),
        "station": meaning.address,
        "baud": meaning.baud,
        "protocols": list(meaning.protocols),
    }


def picture(switches: Sequence[bool]) -> str:
    """Return the block as it looks on the module, switch 1 on the left."""
    edge = "      +" + "---+" * len(switches)
    on = "".join(" # |" if switch else "   |" for switch in switches)
    off = "".join("   |" if switch else " # |" for switch in switches)
    numbers = "".join(f" {number}  " for number in range(1, len(switches) + 1))
    bits = "".join(f" {switch:d}  " for switch in switches)
    return "\n".join(
        [
            edge,
            f"   ON |{on}",
            f"  OFF |{off}",
            edge,
            f"       {numbers.rstrip()}",
            f"       {bits.rstrip()}",
            "       `---- station ----' `baud-' protocol",
        ]
    )


def describe(meaning: DipMeaning) -> str:
    """Return the meaning of the switches in words."""
    protocols = " and ".join(_PROTOCOL_NAMES[protocol] for protocol in meaning.protocols)
    text = f"station {meaning.address} ({meaning.address:02X}h), {meaning.baud} baud, {protocols}"
    return text if meaning.address else f"{text}\n{_BROADCAST_NOTE}"


def _given(args: argparse.Namespace) -> tuple[bool, ...]:
    if (args.station, args.baud, args.protocol) != (None, None, None):
        raise UsageError("give either switch positions or --station with its options, not both")
    bits = "".join(args.switches)
    if wrong := set(bits) - {"0", "1"}:
        raise UsageError(f"switches are 0 or 1, and {min(wrong)!r} is neither")
    return tuple(bit == "1" for bit in bits)


def _wanted(args: argparse.Namespace) -> tuple[bool, ...]:
    if args.station is None:
        raise UsageError("give eight switch positions, or --station")
    protocol = LineProtocol(args.protocol or LineProtocol.WISCO)
    return switches_for(args.station, args.baud or USUAL_BAUD, protocol)
