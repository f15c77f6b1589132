"""Pages, docstrings and messages are in plain words. The list is the project's own."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")) if path.name != "LICENSE"
)
CODE = sorted((ROOT / "bridge").rglob("*.py"))
# Words that make a reader look for the actor. Say who or what does it.
VAGUE = re.compile(r"(?i)\b(nobody|somebody|whoever|whom)\b")
MOST_VAGUE = 20
LONGEST_LINE = 120
# A docstring says what the function does: "Return ...", "Publish ...".
QUESTION = re.compile(r"(What|Whether|How|Which|Where|Who|When|Why)\b")
MOST_QUESTIONS = 0.05


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def _prose(path: Path) -> list[str]:
    """Return the lines of a page that are neither code nor a row of a table."""
    lines, in_code = [], False
    for line in path.read_text().splitlines():
        if line.lstrip().startswith("```"):
            in_code = not in_code
        elif not in_code and not line.lstrip().startswith(("|", "[", "![")):
            lines.append(line)
    return lines


def _texts(path: Path) -> list[str]:
    """Return the docstrings and messages of a file."""
    tree = ast.parse(path.read_text())
    return [
        n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str)
    ]


def _docstrings(path: Path) -> list[str]:
    tree = ast.parse(path.read_text())
    kinds = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [node for node in ast.walk(tree) if isinstance(node, kinds)]
    public = [node for node in nodes if not node.name.startswith("_")]
    return [text for node in public if (text := ast.get_docstring(node))]


@pytest.mark.parametrize("path", PAGES, ids=_name)
def test_no_line_of_a_page_is_too_long(path: Path) -> None:
    """A line that has to be scrolled is read by few; tables and code keep their form."""
    assert [line for line in _prose(path) if len(line) > LONGEST_LINE] == []


def test_pages_docstrings_and_messages_name_the_actor() -> None:
    """The vague words stay below a small number in all."""
    found = [
        f"{_name(page)}: {line}" for page in PAGES for line in _prose(page) if VAGUE.search(line)
    ]
    found += [
        f"{_name(file)}: {text}" for file in CODE for text in _texts(file) if VAGUE.search(text)
    ]
    assert len(found) < MOST_VAGUE, "\n".join(found)


def test_docstrings_say_what_is_done() -> None:
    """Few public docstrings begin with a question word."""
    texts = [text for file in CODE for text in _docstrings(file)]
    questions = [text for text in texts if QUESTION.match(text)]
    assert len(questions) < MOST_QUESTIONS * len(texts), "\n".join(questions)
