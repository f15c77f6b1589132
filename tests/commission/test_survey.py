from collections.abc import Collection

import pytest

from bridge.commission.survey import (
    BAUDS,
    PROTOCOLS,
    QUICK,
    QUICK_PROTOCOLS,
    STATIONS,
    THOROUGH,
    Effort,
    survey_of,
)
from bridge.model import BAUD_RATES, LineProtocol


def test_every_baud_rate_and_protocol_is_asked_the_likeliest_first() -> None:
    """9600 baud, and at each rate Wisco, RTU, ASCII; nothing twice, nothing left out."""
    survey = survey_of(BAUD_RATES, PROTOCOLS, STATIONS, THOROUGH)
    asked = [(sweep.baud, sweep.protocol) for sweep in survey.sweeps]
    assert asked[:3] == [(9600, protocol) for protocol in ("wisco", "modbus-rtu", "modbus-ascii")]
    assert set(asked) == {(baud, protocol) for baud in BAUD_RATES for protocol in LineProtocol}
    assert len(asked) == len(set(asked))
    assert sorted(BAUDS) == sorted(BAUD_RATES)


def test_station_0_is_asked_in_wisco_frames_alone() -> None:
    """Station 0 is only asked in Wisco frames, because it is the broadcast address of Modbus."""
    for sweep in survey_of([9600], PROTOCOLS, STATIONS, QUICK).sweeps:
        first = 0 if sweep.protocol is LineProtocol.WISCO else 1
        assert sweep.addresses == tuple(range(first, 32))


@pytest.mark.parametrize(
    ("protocols", "stations", "count"),
    [(PROTOCOLS, [0], 1), ([LineProtocol.MODBUS_RTU], [0], 0), (QUICK_PROTOCOLS, [5, 3], 2)],
)
def test_a_sweep_without_a_station_is_none(
    protocols: Collection[LineProtocol], stations: list[int], count: int
) -> None:
    """A sweep without a station is left out, so no port is opened for it."""
    assert len(survey_of([9600], protocols, stations, QUICK).sweeps) == count


def test_the_time_is_that_of_every_time_out() -> None:
    """The time of a survey is that of every time-out: 32 stations, twice, worked out by hand."""
    survey = survey_of([9600], [LineProtocol.WISCO], STATIONS, Effort(tries=2, margin_s=0.03))
    silent_s = (8 + 8) * 10 / 9600 + 0.005 + 0.03
    assert survey.total_s == pytest.approx(2 * 32 * silent_s)


def test_rtu_also_waits_for_the_silence_that_ends_a_request() -> None:
    """A module answers no sooner (docs/protocol.md section 5)."""
    survey = survey_of([9600], [LineProtocol.MODBUS_RTU], STATIONS, QUICK)
    silent_s = (8 + 7) * 10 / 9600 + 3.5 * 10 / 9600 + 0.005 + QUICK.margin_s
    assert survey.silent_s(survey.sweeps[0]) == pytest.approx(silent_s)
