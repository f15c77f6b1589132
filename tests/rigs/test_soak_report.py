from pathlib import Path

from soak.log_lines import about, kinds
from soak.report import Seen, broken_promises, describe
from soak.samples import Sample


def sample(minute: int, *, rss: int = 30_000, descriptors: int = 16, objects: int = 100) -> Sample:
    """A look at a process."""
    return Sample(60.0 * minute, rss, rss, rss, descriptors, 5, objects)


def well() -> Seen:
    """An hour in which all went well."""
    seen = Seen(60.0, [sample(minute) for minute in range(1, 61)], exit_status=0)
    seen.tally.verdicts["done"] = 1
    return seen


def test_an_hour_in_which_all_went_well_breaks_no_promise() -> None:
    """The report of an hour without faults names no broken promise."""
    assert list(broken_promises(well())) == []
    assert "deaths: 0; exit status at SIGTERM: 0" in list(describe(well()))


def test_memory_may_grow_while_it_warms_up_and_not_after() -> None:
    """256 KiB from minute 15 on are too many."""
    early, late = well(), well()
    early.samples = [sample(m, rss=30_000 + 1000 * min(m, 14)) for m in range(1, 61)]
    late.samples = [sample(m, rss=30_000 + 7 * m) for m in range(1, 61)]
    assert list(broken_promises(early)) == []
    assert len(list(broken_promises(late))) == 1


def test_an_arena_of_memory_that_comes_and_goes_is_no_growth() -> None:
    """Python takes and gives back 1 MiB at a time: every other sample has one more."""
    seen = well()
    seen.samples = [sample(m, rss=30_000 + 1024 * (m % 2)) for m in range(1, 61)]
    assert list(broken_promises(seen)) == []


def test_each_kind_of_harm_breaks_a_promise() -> None:
    """One line for each."""
    seen = well()
    seen.samples[30] = sample(31, descriptors=17, objects=-1)
    for harm in ("missing", "contradicted", "wrong", "twice", "not_sent"):
        setattr(seen.tally, harm, 1)
    seen.tally.longest_s = 6.0
    seen.tally.late = seen.tally.harms["a motor"] = 1
    seen.stops.append("exit status 0")
    seen.steady["dead"] = seen.steady["on another line"] = 21
    seen.starts["on another line"] = 1  # which may say it once more
    seen.not_back.append("a module")
    seen.ended, seen.exit_status = "exit status 1", 1
    assert len(list(broken_promises(seen))) == 15


def test_log_lines_are_counted_by_kind_and_by_station(tmp_path: Path) -> None:
    """Log lines are counted by kind and station, without the parts that vary."""
    log = tmp_path / "log"
    log.write_text(
        "2026-01-01T10:00:00.000+00:00 INFO bridge.line.report: line a station 1 (x): online\n"
        "2026-01-01T10:00:09.125+00:00 INFO bridge.line.report: line a station 12 (x): online\n"
        "2026-01-01T10:00:09.125+00:00 WARNING bridge.line.report: line a station 2 (y): off\n"
        "2026-01-01T10:00:09.125+00:00 WARNING bridge.mqtt.publisher: y do/1 \x1b: refused\n"
    )
    assert kinds(log) == {
        "INFO line a station # (x): online": 2,
        "WARNING line a station # (y): off": 1,
        "WARNING y do/# ?: refused": 1,
    }
    assert about(log, ["x", "y", "z"]) == {"x": 2, "y": 1, "z": 0}
