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
    """All problems at once, each as one line `FILE:LINE:COL: message`; no secret is in them."""
    told = str(_refused(path)).splitlines()

    expected = (one.split(" ", 1) for one in _expected(path))
    assert told == [f"{path}:{place}: {message}" for place, message in expected]
    assert "hunter2" not in "".join(told)


def test_there_are_as_many_bad_files_as_the_project_promises() -> None:
    """docs/failures.md A10 asks for 30 bad files: none of them may get lost unnoticed."""
    assert len(BAD_FILES) >= 30


def test_many_problems_come_in_the_order_of_the_file() -> None:
    """A reader can go through the file once, from top to bottom."""
    problems = _refused(Path(__file__).parent / "bad" / "many_at_once.yaml").problems

    places = [(problem.line, problem.column) for problem in problems]
    assert len(places) > 15
    assert places == sorted(places)
