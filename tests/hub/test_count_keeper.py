import logging
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from support.house import GARAGE, make_config

from bridge.config.current import CurrentConfig
from bridge.config.schema import Config, CountConfig, InputConfig
from bridge.hub import count_keeper
from bridge.hub.count_file import read_counts, write_counts
from bridge.hub.count_keeper import EVERY_S, CountKeeper
from bridge.hub.counts import Counts

METER = ("garage", 3)
WAIT_S = 20.0


def config_in(folder: Path, base: str = "wisco", *, counted: bool = True) -> Config:
    """A house whose state lies in `folder`, and whose input 3 is counted."""
    meter = InputConfig(3, count=CountConfig() if counted else None)
    config = make_config(base=base, stations=(replace(GARAGE, inputs=(meter,)),))
    return replace(config, state_dir=folder)


class KeptCounts:
    """One run: counts, and who keeps them."""

    def __init__(self, config: Config) -> None:
        self.now = 100.0
        self.current = CurrentConfig(config)
        self.counts = Counts(self.current, lambda *_: None)
        self.keeper = CountKeeper(self.current, self.counts)
        self.keeper.open(self.now)

    def rise(self) -> None:
        """Input 3 goes ON."""
        self.counts.rose("garage", 0b100)

    def pass_time(self, seconds: float) -> None:
        """Lets time pass, and what is written then be written."""
        self.now += seconds
        self.keeper.tick(self.now)
        self.keeper.wait(WAIT_S)

    def stop(self) -> None:
        """The run ends."""
        self.keeper.close(WAIT_S)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where the counts of the base topic `wisco` are kept."""
    return tmp_path / "counts-wisco.json"


def test_a_stop_keeps_the_counts_for_the_next_run(tmp_path: Path, path: Path) -> None:
    """Every edge up to the last one."""
    for edges in (1, 2):
        world = KeptCounts(config_in(tmp_path))
        world.rise()
        world.stop()
        assert read_counts(path) == {METER: edges}


def test_edges_are_written_once_in_a_quarter_of_an_hour(tmp_path: Path, path: Path) -> None:
    """However many there are: cards wear out."""
    world = KeptCounts(config_in(tmp_path))
    writes = 0
    for second in range(int(2 * EVERY_S)):
        world.rise()
        before = path.stat().st_ino if path.exists() else None
        world.pass_time(1.0)
        writes += path.exists() and path.stat().st_ino != before
        assert path.exists() is (second + 1 >= EVERY_S)
    assert writes == 2
    assert read_counts(path) == {METER: 2 * EVERY_S}


def test_where_nothing_changes_nothing_is_written(tmp_path: Path, path: Path) -> None:
    """Not at the start, not in a day, not at the stop."""
    write_counts(path, {METER: 5})
    known = path.stat().st_mtime_ns
    world = KeptCounts(config_in(tmp_path))
    for _ in range(96):
        world.pass_time(EVERY_S)
    world.stop()
    assert path.stat().st_mtime_ns == known


def test_where_nothing_is_counted_there_is_no_file(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """And nothing is said of one."""
    with caplog.at_level(logging.INFO):
        world = KeptCounts(config_in(tmp_path / "none", counted=False))
        world.pass_time(EVERY_S)
        world.stop()
    assert list(tmp_path.iterdir()) == []
    assert caplog.messages == []


@pytest.mark.parametrize(
    ("is_folder", "told"),
    [(False, "no counts are kept in {} yet"), (True, "the counts in {} cannot be read")],
)
def test_no_file_and_one_that_cannot_be_read_are_told_once(
    tmp_path: Path, path: Path, is_folder: bool, told: str, caplog: pytest.LogCaptureFixture
) -> None:
    """A first run, or another folder; and a file in whose place a folder stands."""
    if is_folder:
        path.mkdir()
    with caplog.at_level(logging.INFO):
        KeptCounts(config_in(tmp_path))
    [message] = caplog.messages
    assert message.startswith(told.format(path))


def test_a_folder_that_is_not_ours_is_told_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Not a quarter of an hour later, when the first count is to be written."""
    asked: list[Path] = []

    def refuse(folder: Path, _mode: int) -> bool:
        asked.append(folder)
        return False

    monkeypatch.setattr("bridge.hub.count_keeper.os.access", refuse)  # root may write anywhere
    KeptCounts(config_in(tmp_path / "state" / "deep"))
    assert asked == [tmp_path]
    [record] = caplog.records
    assert record.levelno == logging.WARNING
    assert record.message.startswith(f"no counts can be kept in {tmp_path}/state/deep/counts")


@pytest.mark.parametrize("text", ["", "{", '{"garage/di/3": -4}'])
def test_a_damaged_file_is_one_warning_and_done_without(
    tmp_path: Path, path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Counting goes on; the next write mends the file."""
    path.write_text(text)
    world = KeptCounts(config_in(tmp_path))
    [record] = caplog.records
    assert record.levelno == logging.WARNING
    assert f"the counts in {path} are damaged" in record.message
    world.rise()
    world.stop()
    assert read_counts(path) == {METER: 1}


def test_a_disk_that_fails_is_told_once_and_tried_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Every quarter of an hour, until it takes the counts again; that is told too."""
    state = tmp_path / "state"
    state.write_text("a file where a folder should be")
    world = KeptCounts(config_in(state))
    caplog.clear()
    world.rise()
    with caplog.at_level(logging.INFO):
        for _ in range(3):
            world.pass_time(EVERY_S)
        state.unlink()
        world.pass_time(EVERY_S)
    [failed, mended] = caplog.messages
    assert failed.startswith("the counts cannot be written to")
    assert mended.endswith("again")
    assert read_counts(state / "counts-wisco.json") == {METER: 1}


def test_a_disk_that_hangs_holds_up_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Ticks return at once, no second write begins, and the stop does not wait for ever."""
    hangs, begun = threading.Event(), []

    def write(path: Path, counts: Mapping[tuple[str, int], int]) -> None:
        begun.append(path)
        hangs.wait(WAIT_S)
        write_counts(path, counts)

    monkeypatch.setattr(count_keeper, "write_counts", write)
    world = KeptCounts(config_in(tmp_path))
    world.rise()
    for n in range(1, 5):
        world.keeper.tick(world.now + n * EVERY_S)
    world.keeper.close(0.01)
    assert len(begun) == 1
    assert "the disk hangs" in caplog.text
    hangs.set()
    world.keeper.wait(WAIT_S)


def test_a_stop_in_the_middle_of_a_write_keeps_the_last_edges_too(
    tmp_path: Path, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They came after the write had begun: there is another one."""
    world = KeptCounts(config_in(tmp_path))

    def write(path: Path, counts: Mapping[tuple[str, int], int]) -> None:
        if counts == {METER: 1}:
            stopping.wait(WAIT_S)
        write_counts(path, counts)

    stopping = threading.Event()
    monkeypatch.setattr(count_keeper, "write_counts", write)
    world.rise()
    world.keeper.tick(world.now + EVERY_S)
    world.rise()
    stopping.set()
    world.stop()
    assert read_counts(path) == {METER: 2}


def test_two_bridges_in_one_folder_have_a_file_each(tmp_path: Path) -> None:
    """They differ in their base topic."""
    for base in ("wisco", "home/io"):
        world = KeptCounts(config_in(tmp_path, base))
        world.rise()
        world.stop()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "counts-home__io.json",
        "counts-wisco.json",
    ]


def test_another_folder_gets_the_counts_too(tmp_path: Path) -> None:
    """A configuration that names another one is followed, without an edge."""
    world = KeptCounts(config_in(tmp_path / "old"))
    world.rise()
    world.pass_time(EVERY_S)
    world.current.replace(config_in(tmp_path / "new"))
    world.stop()
    assert read_counts(tmp_path / "new" / "counts-wisco.json") == {METER: 1}
