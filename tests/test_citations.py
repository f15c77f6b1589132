"""Every citation in the code points to a heading that exists."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PYTHON = sorted(p for f in ("bridge", "tests", "rigs") for p in (ROOT / f).rglob("*.py"))
PAGE = re.compile(
    r"(docs/[\w/-]+\.md)"
    r"(?:,? (?:(sections? \d(?: and \d)?)|(promises? \d+(?: and \d+)?)|([A-F]\d+)\b))?"
)


def _headings(page: Path) -> str:
    return "\n".join(line for line in page.read_text().splitlines() if line.startswith("#"))


def _wanted(section: str, promise: str, failure: str) -> list[str]:
    wanted = [rf"(?m)^## {n}\." for n in re.findall(r"\d+", section)]
    wanted += [rf"(?m)^### Promise {n}:" for n in re.findall(r"\d+", promise)]
    return wanted + [rf"(?m)^### {failure}:"] * bool(failure)


@pytest.mark.parametrize("path", PYTHON, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_file_cites_is_in_the_tree(path: Path) -> None:
    """The page is there, and so is the section, the promise or the failure that is named."""
    text = re.sub(r"\s*\n\s*#?\s*", " ", path.read_text())
    for page, *places in PAGE.findall(text):
        assert (ROOT / page).is_file(), page
        for heading in _wanted(*places):
            assert re.search(heading, _headings(ROOT / page)), f"{page}: {heading}"


@pytest.mark.parametrize("path", PYTHON, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_cites_nothing_outside_the_tree(path: Path) -> None:
    """A page that only its author has explains nothing to the next reader."""
    assert not re.search(r"\b[A-Z]{6,}\.md\b(?<!README\.md)(?<!CHANGELOG\.md)", path.read_text())
