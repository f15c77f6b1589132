from dataclasses import replace

import pytest
from support.virtual_worker import make_line, make_station

from bridge.config.schema import GestureConfig, InputConfig, LineConfig
from bridge.line.forecast import forecast, gestures_too_fast
from bridge.model import DO100, LineProtocol, Writes


def line(protocol: LineProtocol, baud: int, turnaround_s: float = 0.002) -> LineConfig:
    """A DIO100 and a DO100, all of which is read equally often."""
    config = make_line(make_station(1), make_station(2, DO100), protocol=protocol, baud=baud)
    return LineConfig(
        config.id,
        config.port,
        baud,
        protocol,
        config.stations,
        turnaround_s=turnaround_s,
        output_sweep_s=0.0,
    )


@pytest.mark.parametrize(
    ("protocol", "baud", "characters", "silences_s"),
    [
        (LineProtocol.WISCO, 9600, (16, 14, 16, 96), 0.0),
        (LineProtocol.MODBUS_RTU, 9600, (15, 14, 15, 47), 2 * 3.5 * 10 / 9600),
        (LineProtocol.MODBUS_RTU, 57600, (15, 14, 15, 47), 2 * 0.00175),
        (LineProtocol.MODBUS_ASCII, 4800, (32, 30, 32, 96), 0.0),
    ],
)
def test_the_forecast_is_the_floor_of_every_exchange_of_a_round(
    protocol: LineProtocol, baud: int, characters: tuple[int, ...], silences_s: float
) -> None:
    """The table and the formula of docs/protocol.md section 5.

    A bound has a read of settings in it.
    """
    inputs_s, outputs_s, do100_s, settings_s = [
        c * 10 / baud + silences_s + 0.002 for c in characters
    ]
    found = forecast(line(protocol, baud))
    cycle_s = inputs_s + outputs_s + do100_s
    assert found.cycle_s == pytest.approx(cycle_s)
    cycle_s += settings_s
    assert found.bound_s == pytest.approx({"s1": cycle_s + inputs_s, "s2": cycle_s + do100_s})


def test_inputs_and_outputs_have_bounds_of_their_own() -> None:
    """Outputs are swept in 2 s; the inputs' round holds at most one of those reads here."""
    config = replace(line(LineProtocol.MODBUS_RTU, 57600), output_sweep_s=2.0)
    found = forecast(config)
    inputs_s, outputs_s, do100_s, settings_s = [c / 5760 + 0.0035 + 0.002 for c in (15, 14, 15, 47)]
    assert found.cycle_s == pytest.approx(inputs_s + do100_s)
    own_s = 2 * inputs_s + do100_s + settings_s
    assert found.inputs_s == pytest.approx({"s1": own_s})
    assert found.outputs_s == pytest.approx(
        {"s1": 1.9 + own_s + outputs_s, "s2": 1.9 + own_s + do100_s}
    )
    assert found.bound_s == found.outputs_s


def test_a_line_of_outputs_alone_sweeps_nothing() -> None:
    """A line with only outputs has no sweep: they are read all the time."""
    stations = make_station(1, DO100), make_station(2, DO100)
    config = make_line(*stations, writes=Writes.WISCO)
    found = forecast(config)
    assert found.inputs_s == {}
    assert found.bound_s == pytest.approx(dict.fromkeys(("s1", "s2"), 1.5 * found.cycle_s))


def buttons(baud: int, *, long_s: float = 0.8, double_s: float = 0.4) -> list[str]:
    """Return the advice on a DIO100 with a button at input 3, at one of three stations."""
    button = InputConfig(3, gestures=GestureConfig(long_s, double_s))
    station_config = make_station(1, inputs=(InputConfig(1), button))
    config = make_line(station_config, make_station(2), make_station(3), baud=baud)
    return list(gestures_too_fast(config, forecast(config)))


def test_buttons_that_are_read_often_enough_are_nothing_to_speak_of() -> None:
    """At the highest baud rate, with the times that are taken when none are said."""
    assert buttons(57600) == []


def test_buttons_that_are_read_too_seldom_are_named() -> None:
    """A press could fall between two reads, or two presses into one."""
    [advice] = buttons(4800, double_s=0.2)
    assert advice.startswith("station s1: input 3 is read every ")
    assert "told apart by 200 ms; give the station priority: high" in advice


def test_without_double_presses_the_long_one_alone_counts() -> None:
    """`double: 0s` is no time to be short of."""
    assert buttons(4800, double_s=0.0) == []
    [advice] = buttons(4800, long_s=0.2, double_s=0.0)
    assert "told apart by 200 ms" in advice
