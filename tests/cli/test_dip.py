"""`wisco2mqtt dip` as a person uses it."""

import pytest

from bridge.cli.main import main

STATION_13 = """\
      +---+---+---+---+---+---+---+---+
   ON | # |   | # | # |   | # |   | # |
  OFF |   | # |   |   | # |   | # |   |
      +---+---+---+---+---+---+---+---+
        1   2   3   4   5   6   7   8
        1   0   1   1   0   1   0   1
       `---- station ----' `baud-' protocol
station 13 (0Dh), 9600 baud, Wisco and Modbus ASCII
"""


@pytest.mark.parametrize(
    "arguments",
    [
        "--station 13 --baud 9600 --protocol wisco",
        "--station 13 --protocol modbus-ascii",
        "--station 13",
        "10110 10 1",
        "10110101",
        "1 0 1 1 0 1 0 1",
    ],
)
def test_both_ways_show_the_same_picture(
    arguments: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Flags and positions of one setting give one picture and one meaning."""
    assert main(["dip", *arguments.split()]) == 0
    assert capsys.readouterr().out == STATION_13


def test_switch_8_off_is_modbus_rtu(capsys: pytest.CaptureFixture[str]) -> None:
    """With switch 8 OFF the module speaks Modbus RTU alone."""
    assert main(["dip", "11111110"]) == 0
    assert capsys.readouterr().out.endswith("station 31 (1Fh), 57600 baud, Modbus RTU\n")


def test_station_0_comes_with_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    """The picture for station 0 warns that no module replies to Modbus address 0."""
    assert main(["dip", "--station", "0"]) == 0
    assert "Station 0 is of use with Wisco frames alone" in capsys.readouterr().out
