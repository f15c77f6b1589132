"""The meaning of the eight DIP switches, in both directions (docs/protocol.md section 1)."""

from collections.abc import Sequence
from dataclasses import dataclass

from bridge.model import BAUD_RATES, LineProtocol

SWITCHES = 8
STATION_SWITCHES = 5
STATIONS = 1 << STATION_SWITCHES


@dataclass(frozen=True, slots=True)
class DipMeaning:
    """The meaning of one position of the switches.

    Attributes:
        protocols: The protocols that the module answers. With switch 8 ON these are two: the module
            tells them apart by the first character of a frame.
    """

    address: int
    baud: int
    protocols: tuple[LineProtocol, ...]


def switches_for(address: int, baud: int, protocol: LineProtocol) -> tuple[bool, ...]:
    """Return the eight positions, switch 1 first; True is ON."""
    if not 0 <= address < STATIONS:
        raise ValueError(f"station {address} is not one of 0-{STATIONS - 1}")
    if baud not in BAUD_RATES:
        raise ValueError(f"{baud} baud is not one of {', '.join(map(str, BAUD_RATES))}")
    # Switch 1 is the lowest bit of the station, switch 6 that of the baud rate.
    bits = address | BAUD_RATES.index(baud) << STATION_SWITCHES
    if protocol is not LineProtocol.MODBUS_RTU:
        bits |= 1 << SWITCHES - 1
    return tuple(bool(bits >> index & 1) for index in range(SWITCHES))


def meaning_of(switches: Sequence[bool]) -> DipMeaning:
    """Return the meaning of eight positions, switch 1 first; True is ON."""
    if len(switches) != SWITCHES:
        raise ValueError(f"{len(switches)} switches given: a module has {SWITCHES}")
    bits = sum(on << index for index, on in enumerate(switches))
    both = (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
    return DipMeaning(
        address=bits % STATIONS,
        baud=BAUD_RATES[bits // STATIONS % len(BAUD_RATES)],
        protocols=both if switches[-1] else (LineProtocol.MODBUS_RTU,),
    )
