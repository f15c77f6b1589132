"""Every file in `bad/` says in its first lines, after `# expect`, all that is wrong with it."""

from pathlib import Path

import pytest

from bridge.config.load import load_config
from bridge.errors import ConfigError

BAD_FILES = sorted((Path(__file__).parent / "bad").glob("*.yaml"))
MARK = "# expect "


def _expected(path: Path) -> list[str]:
    lines = path.read_text(encoding="utf-8").split("\n")
    return [line.removeprefix(MARK) for line in lines if line.startswith(MARK)]


def _refused(path: Path) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        load_config(path, {"HOME": "/home/wisco"})
    return caught.value


@pytest.mark.parametrize("path", BAD_FILES, ids=lambda path: str(path.stem))
def test_a_bad_file_is_refused_with_each_problem_at_its_place(path: Path) -> None:
    """All problems of a file are told at once, each with line, column and what to do."""
    problems = _refused(path).problems

    assert [f"{it.line}:{it.column} {it.message}" for it in problems] == _expected(path)


@pytest.mark.parametrize("path", BAD_FILES, ids=lambda path: str(path.stem))
def test_a_problem_is_one_line_with_its_file_and_no_secret(path: Path) -> None:
    """A message is one line as `FILE:LINE:COL: message`, and `hunter2` is in none of them."""
    told = str(_refused(path))

    assert len(told.splitlines()) == len(_expected(path))
    assert all(line.startswith(f"{path}:") for line in told.splitlines())
    assert "hunter2" not in told


def test_there_are_as_many_bad_files_as_the_project_promises() -> None:
    """docs/failures.md A10 asks for 30 bad files: none of them may get lost unnoticed."""
    assert len(BAD_FILES) >= 30


def test_many_problems_come_in_the_order_of_the_file() -> None:
    """A reader can go through the file once, from top to bottom."""
    problems = _refused(Path(__file__).parent / "bad" / "many_at_once.yaml").problems

    places = [(problem.line, problem.column) for problem in problems]
    assert len(places) > 15
    assert places == sorted(places)
