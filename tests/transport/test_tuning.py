"""The times that a line learns of its modules."""

import pytest
from support.virtual_panel import VirtualPanel

from bridge.config.schema import LineConfig
from bridge.errors import NoReplyError
from bridge.model import DIO100, LineProtocol
from bridge.protocol.wisco import ReadInputsHex
from bridge.simulator.dialect import Dialect
from bridge.simulator.faults import FaultKind
from bridge.simulator.module import SimulatedModule
from bridge.transport.bus import Bus, bus_of
from bridge.transport.timing import LineTiming
from bridge.transport.tuning import Tuned, Tuning

TIMING = LineTiming(baud=9600, turnaround_s=0.005, silence_s=0.004, end_silence_s=0.004)
ALL = Tuned(turnaround=True, late_window=True, silence=True)
STATION = 4
LINE = LineConfig(
    "main",
    "virtual",
    9600,
    LineProtocol.WISCO,
    stations=(),
    turnaround_auto=True,
    late_window_auto=True,
)


def test_fixed_values_stay_fixed() -> None:
    """Whatever is seen, a line that asks for no `auto` keeps its times."""
    tuning = Tuning(TIMING, 0.3, Tuned())
    tuning.replied(STATION, 0.5)
    assert not tuning.wants_silence(STATION)
    assert tuning.turnaround_s(STATION) == 0.005
    assert tuning.late_window_s(STATION) == 0.3
    assert tuning.silence_s(STATION) == 0.004


@pytest.mark.parametrize(
    ("began_s", "turnaround_s", "late_window_s"),
    [((0.001,), 0.005, 0.3), ((0.4, 0.01), 0.4, 0.5), ((30.0,), None, 1.25)],
    ids=["a quick module changes nothing", "a shorter one takes nothing off", "noise has a limit"],
)
def test_the_longest_reply_counts_with_a_margin(
    began_s: tuple[float, ...], turnaround_s: float | None, late_window_s: float
) -> None:
    """A quarter more than the longest, within limits; of another station nothing is learned."""
    tuning = Tuning(TIMING, 0.3, ALL)
    for seconds in began_s:
        tuning.replied(STATION, seconds)
    if turnaround_s is not None:
        assert tuning.turnaround_s(STATION) == pytest.approx(turnaround_s)
    assert tuning.late_window_s(STATION) == pytest.approx(late_window_s)
    assert tuning.late_window_s(STATION + 1) == 0.3


def test_silence_grows_up_to_20_ms() -> None:
    """It doubles as long as the module misses requests; then the caller has to name it."""
    tuning = Tuning(TIMING, 0.3, ALL)
    grown = []
    while tuning.wants_silence(STATION):
        grown.append(tuning.silence_s(STATION))
    assert grown == [0.008, 0.016, 0.02]


def test_a_module_that_went_offline_is_forgotten() -> None:
    """Another one may have taken its place."""
    tuning = Tuning(TIMING, 0.3, ALL)
    tuning.replied(STATION, 0.4)
    tuning.wants_silence(STATION)
    tuning.forget(STATION)
    assert tuning.learned(STATION).late_window_s == 0.3
    assert tuning.silence_s(STATION) == 0.004


def test_a_fixed_time_out_leaves_no_turnaround_to_learn() -> None:
    """The time-out of the configuration decides."""
    line = LineConfig(
        "main", "virtual", 9600, LineProtocol.WISCO, (), timeout_s=0.2, turnaround_auto=True
    )
    assert not Tuned.of(line).turnaround


def _panel(*dialects: Dialect, turnaround_s: float = 0.002) -> tuple[VirtualPanel, Bus]:
    panel = VirtualPanel(
        LineProtocol.WISCO,
        9600,
        [SimulatedModule(DIO100, STATION)],
        turnaround_s=turnaround_s,
        dialects=dialects,
    )
    return panel, bus_of(LINE, panel.open(9600), panel.time.clock, panel.time.sleep)


def _missed(bus: Bus, times: int) -> int:
    missed = 0
    for _ in range(times):
        try:
            bus.exchange(ReadInputsHex(STATION), protected=False)
        except NoReplyError:
            missed += 1
    return missed


def test_a_module_that_is_too_slow_for_the_time_out_is_heard_after_some_requests() -> None:
    """Replies that begin after 250 ms miss the usual time-out: it grows until they fit."""
    _, bus = _panel(turnaround_s=0.25)
    assert _missed(bus, 10) == 1
    assert bus.learned(STATION).turnaround_s == pytest.approx(1.25 * 0.25 - 0.1, abs=0.06)


def test_a_late_reply_makes_its_window_longer() -> None:
    """A reply that begins 290 ms after its time-out: the next window is longer than that by far."""
    panel, bus = _panel()
    panel.faults.set(FaultKind.LATE, probability=1.0, delay_s=0.39)
    with pytest.raises(NoReplyError):
        bus.exchange(ReadInputsHex(STATION), protected=False)
    panel.faults.set(FaultKind.LATE, probability=0.0)
    bus.exchange(ReadInputsHex(STATION), protected=False)
    assert bus.learned(STATION).late_window_s == pytest.approx(1.25 * 0.392, abs=0.03)


def test_a_module_that_needs_silence_gets_it() -> None:
    """Requests within 4 ms of the last reply are not heard: after some misses none is so soon."""
    _, bus = _panel(Dialect.NEEDS_SILENCE)
    _missed(bus, 30)
    assert (bus.learned(STATION).silence_s or 0) >= 0.004
    assert _missed(bus, 100) == 0
