import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.hub.count_file import read_counts, write_counts

COUNTS = {("garage", 3): 12, ("main_02", 16): 0, ("garage", 16): 10**15}


def test_what_was_written_is_read(tmp_path: Path) -> None:
    """In a folder that was not there before; written twice, there is one file."""
    path = tmp_path / "new" / "folder" / "counts.json"
    for _ in range(2):
        write_counts(path, COUNTS)
    assert read_counts(path) == COUNTS
    assert list(path.parent.iterdir()) == [path]


def test_people_can_read_and_mend_it(tmp_path: Path) -> None:
    """One line a count, named as its topic is."""
    path = tmp_path / "counts.json"
    write_counts(path, {("garage", 3): 12})
    assert path.read_text() == '{\n"garage/di/3": 12\n}\n'


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    """The new file takes the place of the old one only when it is whole."""
    path = tmp_path / "counts.json"
    write_counts(path, COUNTS)
    (tmp_path / "counts.json.new").mkdir()  # nothing can be written there
    with pytest.raises(OSError, match="new"):
        write_counts(path, {("garage", 3): 13})
    assert read_counts(path) == COUNTS


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "Expecting value"),
        ("[]", "no JSON object"),
        ("[" * 100_000, "nested too deeply"),
        ('{"garage/di/3": 1', "delimiter"),
        ('{"garage/di/3": -1}', "garage/di/3 has no count"),
        ('{"garage/di/3": 1.5}', "garage/di/3 has no count"),
        ('{"garage/di/3": true}', "garage/di/3 has no count"),
        ('{"garage/di/3": "1"}', "garage/di/3 has no count"),
        (f'{{"garage/di/3": {10**16}}}', "garage/di/3 has no count"),
        ('{"garage/do/3": 1}', "'garage/do/3' is no input"),
        ('{"Garage/di/3": 1}', "'Garage/di/3' is no input"),
        ('{"garage/di/03": 1}', "'garage/di/03' is no input"),
        ('{"-/di/3": 1}', "'-/di/3' is no input"),
        ("\x00" * 4096, "Expecting value"),
        ('{"a/di/1": 1}' + " " * 1_000_000, "more than 1000000 bytes"),
    ],
)
def test_a_damaged_file_says_what_is_wrong(tmp_path: Path, text: str, told: str) -> None:
    """In words for a log line, and as an error that the caller expects."""
    path = tmp_path / "counts.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=told):
        read_counts(path)


@given(st.binary(max_size=200))
def test_no_content_is_more_than_damaged(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    """Any content of the file gives counts or a ValueError."""
    path = tmp_path_factory.mktemp("counts") / "counts.json"
    path.write_bytes(data)
    try:
        counts = read_counts(path)
    except ValueError:
        return
    assert counts == {} or set(json.loads(data)) == {f"{s}/di/{n}" for s, n in counts}
