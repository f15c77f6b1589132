"""The figures that a line worker measures, on a virtual line."""

from dataclasses import replace
from itertools import pairwise
from typing import TypeVar

import pytest
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.line.forecast import forecast
from bridge.model import DO100, ExchangeCounts, LineMeasured, StationMeasured

pytestmark = pytest.mark.warns  # what goes wrong here is logged

M = TypeVar("M", LineMeasured, StationMeasured)


def of(worker: VirtualWorker, kind: type[M]) -> list[M]:
    """The measures of one kind, oldest first."""
    return [measured for _, measured in worker.measured if isinstance(measured, kind)]


def of_station(worker: VirtualWorker, station_id: str) -> list[StationMeasured]:
    """Return the figures of one station, oldest first."""
    return [m for m in of(worker, StationMeasured) if m.station_id == station_id]


def test_measures_come_early_once_and_then_once_a_minute() -> None:
    """The line and each station, together; never twice within 60 s."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2, DO100)))
    worker.run(290.0)
    at = [instant for instant, measured in worker.measured if isinstance(measured, LineMeasured)]
    assert at[0] == pytest.approx(105.0, abs=0.5)
    assert len(at) == 4
    assert all(60.0 <= later - earlier < 61.0 for earlier, later in pairwise(at))
    assert len(of_station(worker, "s1")) == len(of_station(worker, "s2")) == 4


def test_a_healthy_line_measures_what_the_plan_foresees() -> None:
    """The times between reads lie below the bound, a round takes a cycle, and nothing is idle."""
    config = replace(make_line(make_station(1), make_station(2, DO100)), output_sweep_s=0.0)
    plan = forecast(config)
    worker = VirtualWorker(config)
    worker.run(170.0)
    line = of(worker, LineMeasured)[-1]
    assert line.cycle is not None
    assert plan.cycle_s * 0.999 <= line.cycle.p50_s <= plan.cycle_s * 1.06
    assert line.utilisation == pytest.approx(1.0, abs=0.01)
    for station_id in ("s1", "s2"):
        measured = of_station(worker, station_id)[-1]
        assert measured.poll is not None
        assert measured.bound_s == plan.bound_s[station_id]
        assert measured.poll.p99_s <= measured.bound_s * 1.06
        assert measured.age_s is not None
        assert measured.poll.p50_s * 0.95 <= measured.age_s <= measured.bound_s
        assert measured.last_error is None
        assert measured.last_seen == pytest.approx(worker.measured[-1][0], abs=0.2)


def test_where_outputs_are_swept_a_round_is_one_of_inputs() -> None:
    """No round takes longer than the cycle that is foreseen, and most take less."""
    config = make_line(make_station(1), make_station(2, DO100))
    plan = forecast(config)
    worker = VirtualWorker(config)
    worker.run(170.0)
    cycle = of(worker, LineMeasured)[-1].cycle
    assert cycle is not None
    assert cycle.p50_s <= plan.cycle_s * 0.6
    assert plan.cycle_s * 0.95 <= cycle.p99_s <= plan.cycle_s * 1.06
    for station_id in ("s1", "s2"):
        age_s = of_station(worker, station_id)[-1].age_s
        assert age_s is not None
        assert age_s <= plan.bound_s[station_id]


def test_reply_times_count_from_the_request() -> None:
    """Reply times begin with the request, without the silence before it."""
    worker = VirtualWorker(make_line(make_station()))
    worker.run(106.0)
    (measured,) = of_station(worker, "s1")
    assert measured.reply is not None
    read_s = (8 + 8) * 10 / 9600 + 0.005  # the virtual module takes 5 ms
    assert read_s * 0.9 <= measured.reply.p50_s <= read_s * 1.05


def test_every_exchange_is_counted_by_how_it_ended() -> None:
    """Lost replies are silent, damaged ones bad; the line has the sum of its stations."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2, DO100)))
    faults = {105.5: Fault.LOSE_REPLY, 108.0: Fault.GARBLE_REPLY, 110.0: Fault.LOSE_REPLY}

    def fault(frame: bytes) -> Fault | None:
        due = [at for at in faults if at <= worker.line.now and frame.startswith(b"#01")]
        return faults.pop(due[0]) if due else None

    worker.line.fault = fault
    worker.run(166.0)
    one, two = (of_station(worker, station_id)[-1] for station_id in ("s1", "s2"))
    assert (one.counts.silent, one.counts.bad, one.counts.refused) == (2, 1, 0)
    assert one.last_error == "station 1 did not answer"
    # A DO100 refuses the input read that tells it from a DIO100: a valid answer, and no error.
    assert (two.counts.silent, two.counts.bad, two.counts.refused) == (0, 0, 1)
    assert two.last_error is None
    line = of(worker, LineMeasured)[-1]
    assert line.counts == ExchangeCounts(one.counts.good + two.counts.good, 2, 1, 1)


def test_counts_go_on_when_the_port_was_reopened() -> None:
    """Counts continue when the port is opened again."""
    worker = VirtualWorker(replace(make_line(), output_sweep_s=0.0))

    def unplug() -> None:
        worker.line.fault = lambda _: Fault.PORT_GONE
        worker.line.at(worker.line.now + 1, lambda: setattr(worker.line, "fault", lambda _: None))

    worker.line.at(110.0, unplug)
    worker.run(166.0)
    first, second = of_station(worker, "s1")
    assert second.counts.good > first.counts.good + 1000
    assert second.age_s is not None
    assert second.age_s < 1.0  # while the port was away nobody took its values for true


def test_a_port_that_is_away_is_reported_too() -> None:
    """With the port away, reports have no times and no cycles, and utilisation 0."""
    worker = VirtualWorker()
    worker.line.open_error = "not there"
    worker.run(166.0)
    line, station = of(worker, LineMeasured)[-1], of_station(worker, "s1")[-1]
    assert line == LineMeasured("main", None, 0.0, ExchangeCounts(0, 0, 0, 0), 0)
    assert (station.poll, station.reply, station.age_s) == (None, None, None)
    assert (station.last_error, station.last_seen) == (None, None)


def test_a_read_that_is_overdue_shows_in_the_age() -> None:
    """A read that is overdue shows in the age, also before it succeeds."""
    config = make_line(make_station(1), make_station(2))
    worker = VirtualWorker(replace(config, output_sweep_s=0.0))
    worker.line.at(163.5, lambda: setattr(worker.line.modules[1], "away", True))
    worker.run(166.0)
    silent, healthy = (of_station(worker, station_id)[-1] for station_id in ("s1", "s2"))
    assert silent.age_s is not None
    assert healthy.age_s is not None
    assert 1.4 <= silent.age_s <= 3.0
    assert healthy.age_s < 1.4


def test_a_module_that_is_away_takes_no_part_in_rounds_and_has_no_age() -> None:
    """A module that is away has no age and does not lengthen cycles; its counters grow."""
    worker = VirtualWorker(make_line(make_station(1), make_station(2)))
    worker.line.at(106.0, lambda: setattr(worker.line.modules[1], "away", True))
    worker.run(226.0)
    away = of_station(worker, "s1")[-1]
    assert away.age_s is None
    assert away.counts.silent > 5
    assert away.last_seen == pytest.approx(106.0, abs=0.2)
    cycle = of(worker, LineMeasured)[-1].cycle
    assert cycle is not None
    assert cycle.p50_s < 0.1


def test_an_idle_line_is_hardly_used() -> None:
    """Without modules the line is almost unused: only rare probes are sent."""
    worker = VirtualWorker()
    worker.line.modules[1].away = True
    worker.run(166.0)
    assert of(worker, LineMeasured)[-1].utilisation < 0.05
