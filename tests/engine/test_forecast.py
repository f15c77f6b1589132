import pytest
from support.virtual_worker import make_line, make_station

from bridge.config.schema import LineConfig
from bridge.engine.forecast import forecast
from bridge.model import DO100, LineProtocol


def line(protocol: LineProtocol, baud: int, turnaround_s: float = 0.002) -> LineConfig:
    """A DIO100 and a DO100."""
    config = make_line(make_station(1), make_station(2, DO100), protocol=protocol, baud=baud)
    return LineConfig(
        config.id, config.port, baud, protocol, config.stations, turnaround_s=turnaround_s
    )


@pytest.mark.parametrize(
    ("protocol", "baud", "characters", "silences_s"),
    [
        (LineProtocol.WISCO, 9600, (16, 14, 16), 0.0),
        (LineProtocol.MODBUS_RTU, 9600, (15, 14, 15), 2 * 3.5 * 10 / 9600),
        (LineProtocol.MODBUS_RTU, 57600, (15, 14, 15), 2 * 0.00175),
        (LineProtocol.MODBUS_ASCII, 4800, (32, 30, 32), 0.0),
    ],
)
def test_the_forecast_is_the_floor_of_every_exchange_of_a_round(
    protocol: LineProtocol, baud: int, characters: tuple[int, ...], silences_s: float
) -> None:
    """The table and the formula of PROTOCOL.md section 5."""
    inputs_s, outputs_s, do100_s = [c * 10 / baud + silences_s + 0.002 for c in characters]
    found = forecast(line(protocol, baud))
    cycle_s = inputs_s + outputs_s + do100_s
    assert found.cycle_s == pytest.approx(cycle_s)
    assert found.bound_s == pytest.approx({"s1": cycle_s + inputs_s, "s2": cycle_s + do100_s})
