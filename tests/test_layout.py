"""The names in the tree."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
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


def test_a_station_is_the_object() -> None:
    """A number on the line is an `address`, an id a `station_id`, what the file says a config."""
    for root in ("bridge", "rigs", "tests"):
        for path in sorted((ROOT / root).rglob("*.py")):
            text = path.read_text()
            if not re.search(r"\bstation\s*:|def station\b", text):
                continue  # there is nothing to find, and to parse a file takes its time
            for line, written in _annotated(ast.parse(text), "station"):
                kinds = {kind.strip() for kind in written.split("|")} - {"None"}
                assert not kinds & {"int", "str", "StationConfig"}, f"{path}:{line}: {written}"


def _annotated(tree: ast.AST, name: str) -> Iterator[tuple[int, str]]:
    """Yield line and annotation of each parameter, field and property of this name."""
    for node in ast.walk(tree):
        match node:
            case ast.arg(arg=found, annotation=ast.expr() as kind):
                pass
            case ast.AnnAssign(target=ast.Name(id=found) | ast.Attribute(attr=found)):
                kind = node.annotation
            case ast.FunctionDef(
                name=found, returns=ast.expr() as kind, decorator_list=[ast.Name(id="property"), *_]
            ):
                pass
            case _:
                continue
        if found == name:
            yield node.lineno, ast.unparse(kind)
