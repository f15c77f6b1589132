"""The names in the tree."""

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_a_class_name_stands_once_in_the_tree() -> None:
    """A reader who searches for a class of `bridge` finds one; `_Name` counts as `Name`."""
    names = Counter(
        node.name.lstrip("_")
        for path in (ROOT / "bridge").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in names.items() if count > 1] == []
