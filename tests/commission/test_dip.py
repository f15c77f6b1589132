"""The DIP switch rules, against the tables printed in the DIO100's manual."""

from itertools import product

import pytest

from bridge.commission.dip import DipMeaning, meaning_of, switches_for
from bridge.model import LineProtocol

WISCO, RTU, ASCII = LineProtocol.WISCO, LineProtocol.MODBUS_RTU, LineProtocol.MODBUS_ASCII

# The manual's table of stations: switches 1-5 as printed, and the station with its hex form.
MANUAL_STATIONS = """
00000  0 00h | 11010 11 0Bh | 01101 22 16h
10000  1 01h | 00110 12 0Ch | 11101 23 17h
01000  2 02h | 10110 13 0Dh | 00011 24 18h
11000  3 03h | 01110 14 0Eh | 10011 25 19h
00100  4 04h | 11110 15 0Fh | 01011 26 1Ah
10100  5 05h | 00001 16 10h | 11011 27 1Bh
01100  6 06h | 10001 17 11h | 00111 28 1Ch
11100  7 07h | 01001 18 12h | 10111 29 1Dh
00010  8 08h | 11001 19 13h | 01111 30 1Eh
10010  9 09h | 00101 20 14h | 11111 31 1Fh
01010 10 0Ah | 10101 21 15h
"""
# The manual's tables of switches 6-7 and 8.
MANUAL_BAUDS = {"00": 4800, "10": 9600, "01": 19200, "11": 57600}
MANUAL_PROTOCOLS = {"0": (RTU,), "1": (WISCO, ASCII)}


def station_rows() -> dict[str, int]:
    """Reads the table above: switch positions to station."""
    cells = [cell.split() for row in MANUAL_STATIONS.splitlines() for cell in row.split("|")]
    rows = {cell[0]: int(cell[1]) for cell in cells if cell}
    assert all(int(cell[2].removesuffix("h"), 16) == int(cell[1]) for cell in cells if cell)
    return rows


def positions(text: str) -> tuple[bool, ...]:
    """Turns 10110101 into positions."""
    return tuple(bit == "1" for bit in text)


def test_the_table_of_the_manual_is_whole() -> None:
    """All 32 stations are in the table that the other tests stand on."""
    assert sorted(station_rows().values()) == list(range(32))


@pytest.mark.parametrize("protocol", LineProtocol)
def test_every_setting_has_the_switches_of_the_manual(protocol: LineProtocol) -> None:
    """Each of 32 stations and 4 baud rates gives the printed positions for each protocol."""
    for (first, address), (middle, baud), (last, protocols) in product(
        station_rows().items(), MANUAL_BAUDS.items(), MANUAL_PROTOCOLS.items()
    ):
        if protocol in protocols:
            assert switches_for(address, baud, protocol) == positions(first + middle + last)


def test_every_position_has_the_meaning_of_the_manual() -> None:
    """Each of the 256 positions is read as the manual's tables say."""
    for (first, address), (middle, baud), (last, protocols) in product(
        station_rows().items(), MANUAL_BAUDS.items(), MANUAL_PROTOCOLS.items()
    ):
        expected = DipMeaning(address, baud, protocols)
        assert meaning_of(positions(first + middle + last)) == expected


@pytest.mark.parametrize("address", [-1, 32])
def test_a_station_out_of_range_is_refused(address: int) -> None:
    """Five switches count from 0 to 31, and the message says so."""
    with pytest.raises(ValueError, match=f"station {address} is not one of 0-31"):
        switches_for(address, 9600, WISCO)


def test_a_baud_rate_that_the_modules_lack_is_refused() -> None:
    """The message names those that there are."""
    with pytest.raises(ValueError, match="2400 baud is not one of 4800, 9600, 19200, 57600"):
        switches_for(1, 2400, WISCO)


@pytest.mark.parametrize("count", [0, 7, 9])
def test_any_other_number_of_switches_is_refused(count: int) -> None:
    """A module has eight switches, so fewer or more are a slip."""
    with pytest.raises(ValueError, match=f"{count} switches given: a module has 8"):
        meaning_of((False,) * count)
