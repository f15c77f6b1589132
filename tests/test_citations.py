"""Every citation in the code points to a heading that exists."""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

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


def _places(text: str) -> Iterator[tuple[str, str | None]]:
    """Yield each page that a text cites, alone and with each heading of it that is named."""
    for page, *named in PAGE.findall(re.sub(r"\s*\n\s*#?\s*", " ", text)):
        yield page, None
        for heading in _wanted(*named):
            yield page, heading


@cache
def _is_there(page: str, heading: str | None) -> bool:
    path = ROOT / page
    return path.is_file() and (heading is None or bool(re.search(heading, _headings(path))))


def test_what_a_file_cites_is_in_the_tree() -> None:
    """The page is there, and so is the section, the promise or the failure that is named."""
    cited = [(path, place) for path in PYTHON for place in _places(path.read_text())]
    assert len(cited) > 100, "the pattern finds no citations"
    assert [(str(path), *place) for path, place in cited if not _is_there(*place)] == []


def test_a_file_cites_nothing_outside_the_tree() -> None:
    """A page that only its author has explains nothing to the next reader."""
    outside = re.compile(r"\b[A-Z]{6,}\.md\b(?<!README\.md)(?<!CHANGELOG\.md)")
    assert [str(path) for path in PYTHON if outside.search(path.read_text())] == []
