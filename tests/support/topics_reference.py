"""Reads docs/topics.md: the forms of topics in its tables, and its examples.

A form has a letter for each name: `B/S/di/n`, `B/bridge/line/L/availability`.
"""

import json
import re
from pathlib import Path
from typing import Any

_PAGE = Path(__file__).parents[2] / "docs" / "topics.md"
# Names of stations, lines, covers and requests, and numbers of channels.
_NAME = "[a-z0-9_-]+"
_LETTERS = {"S": f"(?!bridge/){_NAME}", "L": _NAME, "ID": _NAME, "V": _NAME, "n": "[0-9]+"}


def page() -> str:
    """The whole page."""
    return _PAGE.read_text(encoding="utf-8")


def section(title: str) -> str:
    """One section of the page, to the next title of its level."""
    return page().split(f"\n## {title}\n")[1].split("\n## ")[0]


def forms(title: str) -> list[str]:
    """The forms in the first column of the first table of a section."""
    rows = re.findall(r"^\| (`B/[^|]*) \|", section(title), flags=re.MULTILINE)
    return [form for row in rows for form in re.findall(r"`([^`]+)`", row)]


def matches(form: str, topic: str, base: str) -> bool:
    """Return whether a topic has this form."""
    levels = [base if level == "B" else _LETTERS.get(level, level) for level in form.split("/")]
    return re.fullmatch("/".join(levels), topic) is not None


def as_filter(form: str) -> str:
    """The form as a filter: a `+` for each letter but the base's."""
    return "/".join("+" if level in _LETTERS else level for level in form.split("/"))


def examples() -> list[dict[str, Any]]:
    """Every example of a payload that stands in a block of its own."""
    blocks = re.findall(r"^```json\n(.*?)^```", page(), flags=re.MULTILINE | re.DOTALL)
    return [json.loads(block) for block in blocks]


def example_with(*keys: str) -> dict[str, Any]:
    """The first example that has these keys."""
    return next(one for one in examples() if set(keys) <= set(one))
