"""Where covers stand, in a file from a stop to the next start."""

import json
import logging
from pathlib import Path

import pytest

from bridge.bounded_log import BoundedLog
from bridge.hub import cover_file
from bridge.hub.cover_file import BELIEVED_S, keep_covers, take_covers
from bridge.model import StandingCover

STANDING = (
    StandingCover(1, "annex", "shutter", "1 20.0, 2 18.0", 40.5),
    StandingCover(2, "yard", "gate", "3 9.0, 4 9.0", 100.0),
)
STOPPED_AT = 1000.0
WAIT_S = 20.0


def log() -> BoundedLog:
    """A log that has told nothing yet."""
    return BoundedLog(logging.getLogger(__name__), lambda: 0.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The file of a stop."""
    path = tmp_path / "state" / "covers-wisco.json"
    keep_covers(path, STANDING, STOPPED_AT, WAIT_S, log())
    return path


def test_a_start_soon_after_the_stop_believes_the_file_and_removes_it(path: Path) -> None:
    """A second start, after a kill, has nothing to believe."""
    assert take_covers(path, STOPPED_AT + BELIEVED_S, log()) == STANDING
    assert list(path.parent.iterdir()) == []
    assert take_covers(path, STOPPED_AT + BELIEVED_S, log()) == ()


@pytest.mark.parametrize("now", [STOPPED_AT + BELIEVED_S + 1, STOPPED_AT - 1])
def test_a_cover_may_have_moved_in_a_long_stop(path: Path, now: float) -> None:
    """Later it is not believed, and removed all the same."""
    assert take_covers(path, now, log()) == ()
    assert not path.exists()


def test_after_a_boot_the_file_is_not_believed(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock of the boot says nothing of the time before it."""
    another = tmp_path / "boot_id"
    another.write_text("another\n")
    monkeypatch.setattr(cover_file, "BOOT_ID", another)
    assert take_covers(path, STOPPED_AT + 1, log()) == ()


def test_where_nothing_stands_no_file_is_written(tmp_path: Path) -> None:
    """A bridge without covers leaves its folder alone."""
    path = tmp_path / "covers-wisco.json"
    keep_covers(path, (), STOPPED_AT, WAIT_S, log())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.warns
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("position", 101.0),
        ("position", True),
        ("position", "40"),
        ("another", 1),
        ("covers", 5),
        ("at", "1000"),
    ],
)
def test_a_damaged_file_is_not_believed(path: Path, key: str, value: object) -> None:
    """Whatever it holds, the start goes on."""
    document = json.loads(path.read_text())
    place = document if key in document else document["covers"][0]
    place[key] = value
    path.write_text(json.dumps(document))
    assert take_covers(path, STOPPED_AT + 1, log()) == ()


@pytest.mark.warns
@pytest.mark.parametrize("text", ["", "{", "[]", "5", "[" * 100_000, "{}", "\xff"])
def test_what_is_no_document_is_told(
    path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    """One line says that the positions are not known."""
    path.write_text(text)
    assert take_covers(path, STOPPED_AT + 1, log()) == ()
    assert "is damaged" in caplog.text


@pytest.mark.warns
def test_a_file_that_cannot_be_removed_is_not_believed(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It would be believed again after a kill."""

    def fail(_: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "unlink", fail)
    assert take_covers(path, STOPPED_AT + 1, log()) == ()
    assert "cannot be read and removed" in caplog.text


@pytest.mark.warns
def test_a_folder_that_cannot_be_written_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The stop goes on."""
    (tmp_path / "state").write_text("a file")
    keep_covers(tmp_path / "state" / "covers-wisco.json", STANDING, STOPPED_AT, WAIT_S, log())
    assert "cannot be written" in caplog.text
