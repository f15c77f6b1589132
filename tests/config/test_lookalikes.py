"""Characters that look like YAML's own: named where they stand, and taken where they are text."""

from pathlib import Path

import pytest
from support.config_file import file_with, problems_of

NBSP = "\u00a0"


@pytest.mark.parametrize(
    ("line", "column", "told"),
    [
        (f"{NBSP} priority: high", 9, "a non-breaking space (U+00A0): type a plain space"),
        (f"priority{NBSP}: high", 17, "a non-breaking space (U+00A0): type a plain space"),
        (f"priority: high{NBSP}", 23, "a non-breaking space (U+00A0): type a plain space"),
        (f"priority:{NBSP}high", 18, "a non-breaking space (U+00A0): type a plain space"),
        ("priority: \u201chigh\u201d", 19, "a curly quote (U+201C): type a plain quote"),
        ("priority: \u2018high\u2019", 19, "a curly quote (U+2018): type a plain quote"),
        ('name: "Shed\u201d', 20, "a curly quote (U+201D): type a plain quote"),
        ("inputs: {1: {name: \u201cA, b\u201d}}", 28, "a curly quote (U+201C): type a plain quote"),
        ("\u202fpriority: high", 9, "a narrow non-breaking space (U+202F)"),
        ("\u3000priority: high", 9, "an ideographic space (U+3000)"),
        ("priority: \u200bhigh", 19, "a space without width (U+200B): remove it"),
    ],
)
def test_each_is_named_at_its_place(line: str, column: int, told: str, tmp_path: Path) -> None:
    """Each look-alike is reported at its place, however YAML reads it."""
    problems = problems_of(tmp_path, file_with(station_keys=line))
    assert problems[0].startswith(f"11:{column} {told}"), problems


def test_a_name_on_the_line_before_an_error_is_not_blamed(tmp_path: Path) -> None:
    """Quotes that stand in a text are no mistake."""
    (problem,) = problems_of(tmp_path, file_with(station_keys="name: Shed \u201cold\u201d\nid: [a"))
    assert "cannot be read as YAML" in problem
